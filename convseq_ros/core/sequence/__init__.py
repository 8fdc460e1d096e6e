# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The query's sequence: the last frames, and their scores along diagonals of the map."""
