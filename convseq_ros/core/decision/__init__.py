# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The decision whether the best candidate is a match."""
