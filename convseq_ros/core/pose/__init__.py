# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the robot was against a place: by cells, by a kept image, and in the map."""
