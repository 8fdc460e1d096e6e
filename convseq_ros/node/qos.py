# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Queues of publishers and services, and a timer that does not need the clock of ROS."""

from collections.abc import Callable
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.timer import Timer

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""A late subscriber receives the last message, too."""

SERVICE_QOS = QoSProfile(depth=1000)
"""
Queue of requests, and of answers that are not acknowledged yet, for all callers together. With the
default of 10, most calls of a fast caller are lost while a frame keeps the processor busy.
"""
# By default, each publisher adds two events to the executor's wait set.
_NO_EVENTS = PublisherEventCallbacks(use_default_callbacks=False)
_DEPTH = 10


def advertise(node: Node, kind: type, topic: str, qos: QoSProfile | int = _DEPTH) -> Any:
    """Return a publisher without events, which the executor would check at each turn."""
    return node.create_publisher(kind, topic, qos, event_callbacks=_NO_EVENTS)


def steady_timer(node: Node, period_s: float, call: Callable[[], None]) -> Timer:
    """Return a timer that is independent of the node's clock."""
    return node.create_timer(period_s, call, clock=Clock(clock_type=ClockType.STEADY_TIME))
