# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Training-free visual place recognition and loop closure on a robot's CPU."""

__version__ = '0.1.0'
