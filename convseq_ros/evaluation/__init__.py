# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The bench: data sets with truth, methods side by side, exact metrics, results as files."""
