# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How messages are kept until somebody takes them."""

from rclpy.qos import DurabilityPolicy, QoSProfile

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Who comes late hears the last message, too."""

SERVICE_QOS = QoSProfile(depth=1000)
"""
Requests, and answers that are not acknowledged yet, of all callers together; with the usual 10,
most calls of a quick caller are lost while a frame keeps the processor busy.
"""
