# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reports as one self-contained HTML page: results of `evaluate`, and what was matched."""
