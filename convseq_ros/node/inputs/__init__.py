# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the nodes listen to: images, and what else is known at their times."""
