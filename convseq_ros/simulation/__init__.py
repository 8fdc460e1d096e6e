# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A drawn street driven several times, with known truth: for the demo and for tests."""
