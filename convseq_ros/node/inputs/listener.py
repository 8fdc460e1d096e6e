# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The thread that takes messages off the node's topics."""

from collections.abc import Callable
from contextlib import ExitStack, suppress
from functools import partial
import threading
from typing import Any, cast

from convseq_ros.errors import ConfigError, with_traceback
from convseq_ros.node.conversions import type_name
from rcl_interfaces.msg import Log
from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import EventHandler
from rclpy.exceptions import InvalidHandle
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation as rcl
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.service import Service
from rclpy.subscription import Subscription
from rosgraph_msgs.msg import Clock

_WAIT_NS = 200_000_000
_END_S = 1.0
_LOG_PERIOD_S = 5.0


class NotExecuted(CallbackGroup):
    """A callback group that an executor leaves alone."""

    def can_execute(self, _entity: Any) -> bool:
        return False


class Listener:
    """
    Calls the callbacks of subscriptions, and of their events, in a separate thread.

    For each message an executor of rclpy checks all services, timers and events of the node twice,
    some 30 of them. That takes longer than the work on an image that is not a keyframe. Here the
    thread waits for the subscriptions only; `group` must be their callback group.
    """

    def __init__(self, node: Node) -> None:
        self.group = NotExecuted()
        self._node, self._ended = node, False
        self._subscriptions: tuple[Subscription, ...] = ()
        self._changing = threading.Lock()
        self._changed = GuardCondition(None, None, node.context)
        self._thread = threading.Thread(target=self._run, name='listener', daemon=True)

    def add(self, subscription: Subscription) -> None:
        """Start calling back with its messages."""
        with self._changing:
            self._subscriptions = *self._subscriptions, subscription
            if self._thread.ident is None:
                self._thread.start()
        self._changed.trigger()

    def discard(self, subscription: Subscription) -> None:
        """Stop calling back with its messages, except for one that is being taken."""
        with self._changing:
            self._subscriptions = tuple(s for s in self._subscriptions if s is not subscription)
        if not self._ended:
            self._changed.trigger()

    def close(self) -> None:
        """End the thread; do not wait if a callback calls this, and at most a second otherwise."""
        if not self._ended:
            self._ended = True
            self._changed.trigger()
            if self._thread.ident not in (None, threading.get_ident()):
                self._thread.join(_END_S)
            self._changed.destroy()

    def _run(self) -> None:
        while not self._ended and self._node.context.ok():
            with ExitStack() as used, suppress(InvalidHandle):
                self._serve(self._subscriptions, used)

    def _serve(self, subscriptions: tuple[Subscription, ...], used: ExitStack) -> None:
        """Call back with messages and events until the subscriptions change."""
        context, changed = self._node.context.handle, self._changed.handle
        events = list[EventHandler]()
        for item in subscriptions:
            events += cast(list[EventHandler], item.event_handlers)  # rclpy types it as one event
        for handle in (context, changed, *(item.handle for item in subscriptions), *events):
            used.enter_context(handle)
        waiting = rcl.WaitSet(len(subscriptions), 1, 0, 0, 0, len(events), context)
        while self._subscriptions is subscriptions and not self._ended and self._node.context.ok():
            waiting.clear_entities()
            waiting.add_guard_condition(changed)
            for subscription in subscriptions:
                waiting.add_subscription(subscription.handle)
            for event in events:
                event.add_to_wait_set(waiting)
            waiting.wait(_WAIT_NS)
            for event in events:
                if event.is_ready(waiting) and (happened := event.take_data()):
                    self._call(event.callback, happened)
            ready = waiting.get_ready_entities('subscription')
            for subscription in subscriptions:
                kind, taker = subscription.msg_type, subscription.handle
                if taker.pointer in ready and (
                    taken := taker.take_message(kind, subscription.raw)
                ):
                    self._call(subscription.callback, *taken)

    def _call(self, callback: Callable[..., None], *arguments: Any) -> None:
        """Call a callback; log its error, so that the next message is handled."""
        try:
            callback(*arguments)
        except Exception as error:
            if self._node.context.ok():
                logger = self._node.get_logger()
                logger.error(with_traceback(error), throttle_duration_sec=_LOG_PERIOD_S)


class ListeningNode(Node):
    """A node that has a listener."""

    def __init__(self, name: str, **kwargs: Any) -> None:
        # By topic; rclpy's own part of a node publishes the log in C.
        self._claims: dict[str, type] = {'/rosout': Log}
        super().__init__(name, **kwargs)
        self.listener = Listener(self)

    def claim(self, topic: str, kind: type) -> None:
        """Raise a ConfigError if a topic is to be of two types: in ROS it has one."""
        other = self._claims.setdefault(topic, kind)
        if other is not kind:
            raise ConfigError(
                f'{topic}: it cannot carry both {type_name(other)} and {type_name(kind)}; give '
                'one of them another topic'
            )

    def create_publisher(self, msg_type: Any, topic: str, *args: Any, **kwargs: Any) -> Publisher:
        self.claim(self.resolve_topic_name(topic), msg_type)
        return super().create_publisher(msg_type, topic, *args, **kwargs)

    def create_subscription(
        self, msg_type: Any, topic: str, callback: Callable[..., None], *args: Any, **kwargs: Any
    ) -> Subscription:
        # rclpy's time source raises an error at a time below zero.
        if msg_type is Clock:
            self.claim(self.resolve_topic_name(topic), Clock)
            callback = partial(self._on_clock, callback)
        return super().create_subscription(msg_type, topic, callback, *args, **kwargs)

    def create_service(self, *args: Any, **kwargs: Any) -> Service:
        """Offer a service; the answer to a call that outlives it is not sent."""
        service: Any = super().create_service(*args, **kwargs)
        send = service.send_response

        def send_response(*answer: Any) -> None:
            with suppress(InvalidHandle):
                send(*answer)

        service.send_response = send_response
        return cast(Service, service)

    def _on_clock(self, set_time: Callable[[Clock], None], message: Clock) -> None:
        if message.clock.sec >= 0:
            set_time(message)
            return
        line = f'/clock: a time of {message.clock.sec} s is left out; it may not be below 0'
        self.get_logger().warning(line, once=True)

    def destroy_subscription(self, subscription: Subscription) -> bool:
        self.listener.discard(subscription)
        return super().destroy_subscription(subscription)

    def destroy_node(self) -> None:
        self.listener.close()
        super().destroy_node()
