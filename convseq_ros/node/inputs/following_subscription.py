# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A subscription that is reliable if the publisher is."""

from collections.abc import Callable
from functools import partial
from threading import RLock
import time
from typing import Any

from convseq_ros.node.conversions import type_name
from convseq_ros.node.inputs.listener import ListeningNode
from rclpy.event_handler import (
    QoSMessageLostInfo,
    QoSRequestedIncompatibleQoSInfo,
    QoSSubscriptionMatchedInfo,
    SubscriptionEventCallbacks,
)
from rclpy.qos import DurabilityPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy

_SILENCE_S = 3.0


class FollowingSubscription:
    """
    Requests reliable delivery, or best effort while a publisher offers only that.

    `on_message` receives each message, or its bytes if `raw`, in the listener's thread; `depth`
    messages may wait. If `latched`, it also receives what publishers that keep their last messages
    sent before. `lost` counts lost messages since the first one: as the middleware reports them
    or, with a single publisher, by gaps in the sequence numbers. `heard` is whether one came since
    the start.
    """

    def __init__(
        self,
        node: ListeningNode,
        kind: type,
        topic: str,
        on_message: Callable[[Any], None],
        depth: int,
        starts: bool = True,
        raw: bool = False,
        latched: bool = False,
    ) -> None:
        self._reported = self._missing = self._last = 0
        self._node, self.kind, self.topic = node, kind, node.resolve_topic_name(topic)
        node.claim(self.topic, kind)
        self._on_message, self._depth, self._raw, self._latched = on_message, depth, raw, latched
        self._subscription: Any = None
        self._changing = RLock()  # other threads stop it while the listener handles events
        if starts:
            self.start()

    def start(self) -> None:
        self._last, self.heard, self._arrived_s = 0, False, time.monotonic()
        self._subscribe()

    def stop(self) -> None:
        with self._changing:
            if self._subscription:
                self._node.destroy_subscription(self._subscription)
            self._subscription = None

    @property
    def silent_s(self) -> float:
        """How long nothing has come, if it is so long that something is wrong; else 0."""
        silent_s = time.monotonic() - self._arrived_s if self._subscription else 0.0
        return silent_s if silent_s >= _SILENCE_S else 0.0

    @property
    def mismatch(self) -> str:
        """Which other types its topic carries; empty if it carries this one, or nothing."""
        ends = self._node.get_publishers_info_by_topic(self.topic)
        types = sorted({end.topic_type for end in ends})
        wanted = type_name(self.kind)
        return '' if wanted in types or not types else f'{", ".join(types)}, not {wanted}'

    @property
    def lost(self) -> int:
        return max(self._reported, self._missing)

    def hold_at_most(self, depth: int) -> None:
        """Let fewer messages wait for the listener from now on."""
        if depth < self._depth and self._subscription:
            self._depth = depth
            self._subscribe(self._reliability, self._durability)

    def _subscribe(
        self,
        reliability: ReliabilityPolicy = ReliabilityPolicy.RELIABLE,
        durability: DurabilityPolicy = DurabilityPolicy.VOLATILE,
    ) -> None:
        with self._changing:
            self.stop()
            self._reliability, self._durability = reliability, durability
            # rclpy's types have no second argument.
            on_message: Any = partial(self._on_numbered, self.kind)
            self._subscription = self._node.create_subscription(
                self.kind,
                self.topic,
                on_message,
                QoSProfile(depth=self._depth, reliability=reliability, durability=durability),
                raw=self._raw,
                callback_group=self._node.listener.group,
                event_callbacks=SubscriptionEventCallbacks(
                    incompatible_qos=self._on_incompatible_qos,
                    message_lost=self._on_lost,
                    matched=self._on_matched,
                    use_default_callbacks=False,
                ),
            )
            self._node.listener.add(self._subscription)

    def _on_incompatible_qos(self, info: QoSRequestedIncompatibleQoSInfo) -> None:
        logger = self._node.get_logger()
        if info.last_policy_kind == QoSPolicyKind.RELIABILITY:
            logger.info(f'{self.topic}: its publisher sends best effort; following it')
            self._subscribe(ReliabilityPolicy.BEST_EFFORT, self._durability)
        elif self._durability is DurabilityPolicy.TRANSIENT_LOCAL:  # of one publisher of several
            self._latched = False
            self._subscribe(self._reliability)
        else:
            line = f'is not heard; compare its QoS: ros2 topic info --verbose {self.topic}'
            logger.warning(f'{self.topic}: a publisher with another QoS {line}')

    def _on_matched(self, info: QoSSubscriptionMatchedInfo) -> None:
        is_strict = self._reliability is ReliabilityPolicy.RELIABLE
        is_volatile = self._durability is DurabilityPolicy.VOLATILE
        # A publisher that came and went between two events is only in the total count.
        if info.total_count and not info.current_count:
            if not (is_strict and is_volatile):
                self._subscribe()
        elif self._latched and is_volatile:
            # Some publishers keep their last messages for those who come later.
            ends = self._node.get_publishers_info_by_topic(self.topic)
            kept = DurabilityPolicy.TRANSIENT_LOCAL
            if any(end.qos_profile.durability is kept for end in ends):
                self._subscribe(self._reliability, kept)

    def _on_lost(self, info: QoSMessageLostInfo) -> None:
        self._reported += info.total_count_change

    def _on_numbered(self, kind: type, message: Any, info: dict[str, Any]) -> None:
        with self._changing:
            if kind is not self.kind:
                return  # it was taken just before the type changed
            number, before = info.get('publication_sequence_number') or 0, self._last
            self._last = number
            if 0 < before < number - 1 and self._node.count_publishers(self.topic) == 1:
                self._missing += number - 1 - before
            self.heard, self._arrived_s = True, time.monotonic()
            self._on_message(message)
