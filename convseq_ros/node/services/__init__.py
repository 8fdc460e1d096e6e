# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the nodes do: the work on frames, services, parameters and states."""
