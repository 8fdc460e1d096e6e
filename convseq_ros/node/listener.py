# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The thread that takes messages off the node's topics."""

from collections.abc import Callable
from contextlib import ExitStack, suppress
import threading
from typing import Any, cast

from convseq_ros.errors import in_full
from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import EventHandler
from rclpy.exceptions import InvalidHandle
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation as rcl
from rclpy.node import Node
from rclpy.subscription import Subscription

_LOOK_UP_NS = 200_000_000
_END_S = 1.0
_LOG_PERIOD_S = 5.0


class NotExecuted(CallbackGroup):
    """Has an executor leave alone what is in this group."""

    def can_execute(self, _entity: Any) -> bool:
        return False


class Listener:
    """
    Calls back with the messages and the events of subscriptions, in a thread of its own.

    For each message an executor of rclpy goes twice through all that the node has, some 30
    services, timers and events, which takes longer than the rest of an image that is no keyframe.
    Here only the subscriptions are waited for; `group` must be their callback group.
    """

    def __init__(self, node: Node) -> None:
        self.group = NotExecuted()
        self._node, self._ended = node, False
        self._heard: tuple[Subscription, ...] = ()
        self._changing = threading.Lock()
        self._changed = GuardCondition(None, None, node.context)
        self._thread = threading.Thread(target=self._run, name='listener', daemon=True)

    def add(self, subscription: Subscription) -> None:
        """Call back with its messages from now on."""
        with self._changing:
            self._heard = *self._heard, subscription
            if self._thread.ident is None:
                self._thread.start()
        self._changed.trigger()

    def discard(self, subscription: Subscription) -> None:
        """Call back with its messages no more, but for one that is being taken."""
        with self._changing:
            self._heard = tuple(one for one in self._heard if one is not subscription)
        if not self._ended:
            self._changed.trigger()

    def close(self) -> None:
        """End the thread, unless a callback calls this or goes on for a second."""
        if not self._ended:
            self._ended = True
            self._changed.trigger()
            if self._thread.ident not in (None, threading.get_ident()):
                self._thread.join(_END_S)
            self._changed.destroy()

    def _run(self) -> None:
        while not self._ended and self._node.context.ok():
            with ExitStack() as used, suppress(InvalidHandle):
                self._take_turns(self._heard, used)

    def _take_turns(self, heard: tuple[Subscription, ...], used: ExitStack) -> None:
        """Call back with what comes until other subscriptions are heard."""
        context, changed = self._node.context.handle, self._changed.handle
        events = list[EventHandler]()
        for one in heard:
            events += cast(list[EventHandler], one.event_handlers)  # rclpy says that it is one
        for one in (context, changed, *(one.handle for one in heard), *events):
            used.enter_context(one)
        waiting = rcl.WaitSet(len(heard), 1, 0, 0, 0, len(events), context)
        while self._heard is heard and not self._ended and self._node.context.ok():
            waiting.clear_entities()
            waiting.add_guard_condition(changed)
            for subscription in heard:
                waiting.add_subscription(subscription.handle)
            for event in events:
                event.add_to_wait_set(waiting)
            waiting.wait(_LOOK_UP_NS)
            for event in events:
                if event.is_ready(waiting) and (happened := event.take_data()):
                    self._call(event.callback, happened)
            ready = waiting.get_ready_entities('subscription')
            for subscription in heard:
                kind, taker = subscription.msg_type, subscription.handle
                if taker.pointer in ready and (
                    taken := taker.take_message(kind, subscription.raw)
                ):
                    self._call(subscription.callback, *taken)

    def _call(self, callback: Callable[..., None], *given: Any) -> None:
        """Call back; an error is logged, and the next message comes."""
        try:
            callback(*given)
        except Exception as error:
            if self._node.context.ok():
                logger = self._node.get_logger()
                logger.error(in_full(error), throttle_duration_sec=_LOG_PERIOD_S)


class ListeningNode(Node):
    """A node that has a listener."""

    def __init__(self, name: str, **kwargs: Any) -> None:
        super().__init__(name, **kwargs)
        self.listener = Listener(self)

    def destroy_subscription(self, subscription: Subscription) -> bool:
        self.listener.discard(subscription)
        return super().destroy_subscription(subscription)

    def destroy_node(self) -> None:
        self.listener.close()
        super().destroy_node()
