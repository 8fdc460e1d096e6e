# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A fleet: many maps, which the workers of a Dask scheduler build and search."""
