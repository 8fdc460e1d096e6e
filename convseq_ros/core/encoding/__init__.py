# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From an image to its descriptor (paper III-B, III-C)."""
