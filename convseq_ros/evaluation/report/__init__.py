# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One self-contained HTML page of what `convseq evaluate` measured."""

from convseq_ros.evaluation.report.charts import write_figures
from convseq_ros.evaluation.report.page import MOST_MEGABYTES, write_report
from convseq_ros.evaluation.report.shown import read_runs

__all__ = ['MOST_MEGABYTES', 'read_runs', 'write_figures', 'write_report']
