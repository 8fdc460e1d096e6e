# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A subscription that is reliable if the publisher is."""

from collections.abc import Callable
from typing import Any

from rclpy.event_handler import (
    QoSMessageLostInfo,
    QoSRequestedIncompatibleQoSInfo,
    QoSSubscriptionMatchedInfo,
    SubscriptionEventCallbacks,
)
from rclpy.node import Node
from rclpy.qos import QoSPolicyKind, QoSProfile, ReliabilityPolicy


class FollowingSubscription:
    """
    Asks for reliable delivery, and gives way to best effort when a publisher offers no better.

    When the last publisher is gone it asks for reliable delivery again: the next may offer it. So
    it is with `auto`; `reliable` and `best_effort` stay with that. `on_message` receives each
    message in the executor's thread, for which `depth` messages may wait.
    """

    def __init__(
        self,
        node: Node,
        kind: type,
        topic: str,
        on_message: Callable[[Any], None],
        depth: int,
        reliability: str = 'auto',
    ) -> None:
        self._reported = self._missing = self._last = 0
        self._node = node
        self._kind, self._topic, self._on_message = kind, topic, on_message
        self._subscription: Any = None
        self._depth = depth
        self._reliability = reliability
        best_effort = reliability == 'best_effort'
        self._subscribe(
            ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE
        )

    @property
    def lost(self) -> int:
        """
        Messages that did not arrive since the first that did.

        That is what the middleware reports and, of a single publisher, whose messages are
        numbered, what its history had no room for.
        """
        return max(self._reported, self._missing)

    def destroy(self) -> None:
        """Hear nothing any more."""
        self._node.destroy_subscription(self._subscription)

    def move(self, topic: str) -> None:
        """Hear another topic instead."""
        self._topic, self._last = topic, 0
        self._subscribe(self._asked, self._is_following)

    def hold_at_most(self, depth: int) -> None:
        """Have fewer messages wait for the executor from now on."""
        if depth < self._depth:
            self._depth = depth
            self._subscribe(self._asked, self._is_following)

    @property
    def topic(self) -> str:
        """The topic as it was resolved."""
        return str(self._subscription.topic_name)

    def _subscribe(self, reliability: ReliabilityPolicy, is_following: bool = False) -> None:
        if self._subscription:
            self._node.destroy_subscription(self._subscription)
        self._asked, self._is_following = reliability, is_following
        on_message: Any = self._on_numbered  # rclpy's types know of no second argument
        self._subscription = self._node.create_subscription(
            self._kind,
            self._topic,
            on_message,
            QoSProfile(depth=self._depth, reliability=reliability),
            event_callbacks=SubscriptionEventCallbacks(
                incompatible_qos=self._on_incompatible_qos,
                message_lost=self._on_lost,
                matched=self._on_matched,
                use_default_callbacks=False,
            ),
        )

    def _on_incompatible_qos(self, info: QoSRequestedIncompatibleQoSInfo) -> None:
        logger = self._node.get_logger()
        if info.last_policy_kind != QoSPolicyKind.RELIABILITY:
            logger.warning(f'{self.topic}: a publisher offers incompatible QoS; it is not heard')
        elif self._reliability == 'auto':
            logger.info(f'{self.topic}: its publisher sends best effort; following it')
            self._subscribe(ReliabilityPolicy.BEST_EFFORT, is_following=True)
        else:
            logger.warning(
                f'{self.topic}: a publisher sends best effort only and is not heard; '
                'set image_reliability to auto'
            )

    def _on_matched(self, info: QoSSubscriptionMatchedInfo) -> None:
        # One that came and went between two looks makes no change, but it counts in the total.
        if self._is_following and info.total_count and not info.current_count:
            self._subscribe(ReliabilityPolicy.RELIABLE)

    def _on_lost(self, info: QoSMessageLostInfo) -> None:
        self._reported += info.total_count_change

    def _on_numbered(self, message: Any, info: dict[str, Any]) -> None:
        number, before = info.get('publication_sequence_number') or 0, self._last
        self._last = number
        if 0 < before < number - 1 and self._node.count_publishers(self.topic) == 1:
            self._missing += number - 1 - before
        self._on_message(message)
