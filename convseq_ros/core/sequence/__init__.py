# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which frames are matched together, and where their diagonals end (paper III-A, E, F, G)."""
