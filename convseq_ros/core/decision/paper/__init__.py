# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The decision of the paper: k frames along a diagonal, the best by a margin."""
