# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The places of a map as a graph: which of them show the same."""
