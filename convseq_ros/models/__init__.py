# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Descriptor models: networks as functions from an image to a vector."""
