# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The ROS side: the only place that imports rclpy and message packages."""

import os

# As in convseq_ros.cli: read when NumPy is imported.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
