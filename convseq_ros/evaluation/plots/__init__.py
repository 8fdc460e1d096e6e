# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figures by matplotlib, which is imported only when one is drawn."""

from convseq_ros.evaluation.plots.demo import demo_picture
from convseq_ros.evaluation.plots.figure import new_figure, save

__all__ = ['demo_picture', 'new_figure', 'save']
