# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Compiled pair scores, fenced; README.md says what is emitted, why, and how to read it."""
