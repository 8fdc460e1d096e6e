# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The frames that are matched together, and their sequence scores (paper III-A, E, F, G)."""
