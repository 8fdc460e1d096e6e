# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether two images show the same scene, by the displacements of regions between them."""
