# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Compiled pair scores; `coherent.py` and `regional.py` one level up define what they compute."""
