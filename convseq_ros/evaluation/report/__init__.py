# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The report: one self-contained HTML page of the results of `convseq evaluate`."""
