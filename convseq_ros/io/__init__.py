# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Files in and out: limits of size, safe reading and writing, the result table."""
