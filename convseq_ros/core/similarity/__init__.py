# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How alike two images are (paper III-D, and ours)."""
