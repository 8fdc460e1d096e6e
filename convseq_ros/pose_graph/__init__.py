# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pose graphs: odometry and loop closures as edges, their robust solution, and g2o files."""
