# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A fleet: many maps, built and answered from by the workers of one scheduler of Dask."""
