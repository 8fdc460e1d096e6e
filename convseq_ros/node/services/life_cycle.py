# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A node that may be managed from outside, state by state (lifecycle_msgs)."""

from collections.abc import Callable
from itertools import chain
from typing import Any

from convseq_ros.errors import ConvseqError, one_line
from convseq_ros.node.inputs.listener import ListeningNode
from rclpy.lifecycle import LifecycleNodeMixin, LifecycleState, TransitionCallbackReturn

PATIENCE_S = 30.0  # for the frame at hand, when the files are to be closed
_DONE, _REFUSED = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


class ManagedNode(LifecycleNodeMixin, ListeningNode):
    """
    A plain node until `manage` is called; from then on its transitions call methods of it.

    Configure calls `open_work`, activate `listen`, deactivate `pause`, cleanup and shutdown
    `close_work`. Cleanup also destroys the topics and services that `open_work` has made.
    """

    def __init__(self, name: str, **kwargs: Any) -> None:
        ListeningNode.__init__(self, name, **kwargs)
        self._permanent: frozenset[Any] | None = None

    def open_work(self) -> None:
        """Open files and make topics and services; ConvseqError or OSError if that fails."""

    def listen(self) -> None:
        """Receive images from now on."""

    def pause(self) -> None:
        """Receive no more images, and keep the state."""

    def close_work(self, patience_s: float = PATIENCE_S) -> None:
        """Close the files after the frame at hand, for which this waits at most `patience_s`."""

    def manage(self) -> None:
        """Offer `~/change_state` and the other services of a managed node."""
        LifecycleNodeMixin.__init__(self, enable_communication_interface=True)

    def destroy_node(self) -> None:
        """Leave the graph: rclpy's state machine would hold the node there."""
        super().destroy_node()
        self.__dict__.pop('_state_machine', None)

    def on_configure(self, _state: LifecycleState) -> TransitionCallbackReturn:
        self._permanent = frozenset(chain.from_iterable(self._entities().values()))
        try:
            self.open_work()
        except (ConvseqError, OSError) as error:
            self.get_logger().error(one_line(error))
            self._destroy_new()
            return _REFUSED
        return _DONE

    def on_activate(self, _state: LifecycleState) -> TransitionCallbackReturn:
        self.listen()
        return _DONE

    def on_deactivate(self, _state: LifecycleState) -> TransitionCallbackReturn:
        self.pause()
        return _DONE

    def on_cleanup(self, _state: LifecycleState) -> TransitionCallbackReturn:
        self.close_work()
        self._destroy_new()
        return _DONE

    on_shutdown = on_error = on_cleanup  # type: ignore[assignment]

    # In rclpy's version, the error of an impossible transition ends the executor.
    def _LifecycleNodeMixin__change_state(self, number: int) -> TransitionCallbackReturn:
        try:
            change: Any = LifecycleNodeMixin.__dict__['_LifecycleNodeMixin__change_state']
            return change(self, number)
        except RuntimeError:
            machine: Any = self._state_machine
            ways = [f'{label} ({at})' for at, label, *_ in machine.available_transitions]
            remedy = f'call {" or ".join(ways)}' if ways else 'end it and start it again'
            self.get_logger().warning(
                f'transition {number} is not possible: the node is {machine.current_state[1]}; '
                f'{remedy}'
            )
            return _REFUSED

    def _entities(self) -> dict[Callable[[Any], bool], list[Any]]:
        """Return the node's entities on the graph, by the function that destroys them."""
        return {
            self.destroy_subscription: [*self.subscriptions],
            self.destroy_publisher: [*self.publishers],
            self.destroy_service: [*self.services],
            self.destroy_timer: [*self.timers],
            self.destroy_guard_condition: [*self.guards],
        }

    def _destroy_new(self) -> None:
        """Destroy the entities that were made since `configure` began."""
        if self._permanent is None:
            return
        for destroy, entities in self._entities().items():
            for entity in entities:
                if entity not in self._permanent:
                    destroy(entity)
        self._permanent = None
