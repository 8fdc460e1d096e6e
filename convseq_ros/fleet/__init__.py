# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A fleet: many maps, which workers of Dask build, and which are asked as one."""
