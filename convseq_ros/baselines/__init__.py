# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What ConvSequential-SLAM is compared with; each gives pair scores, query by reference."""
