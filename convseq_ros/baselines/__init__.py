# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Baselines to compare with; each computes pair scores, query by reference."""
