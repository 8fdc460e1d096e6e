# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What programs make of the method: maps, several cameras, tables and pictures; no ROS."""
