# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The ROS side: the only place that imports rclpy and message packages."""

from convseq_ros.node.process import use_one_thread

use_one_thread()
