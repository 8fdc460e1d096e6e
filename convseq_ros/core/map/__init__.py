# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The reference map: in memory, on disk, and growing."""
