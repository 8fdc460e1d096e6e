# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether two images show one scene: where its regions went, and which of them moved alike."""
