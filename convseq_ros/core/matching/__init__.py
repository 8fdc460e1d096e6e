# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Ways to score a pair of images; each turns one query into a row of scores."""
