# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Similarity scores of two images (paper III-D, and ours)."""
