# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The place recogniser: arrays in, results out; it does not use ROS and prints nothing."""
