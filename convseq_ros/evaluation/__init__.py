# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The evaluation: data sets with ground truth, methods, exact metrics, and result files."""
