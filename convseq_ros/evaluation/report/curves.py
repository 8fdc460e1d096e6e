# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Precision-recall curves of one data set."""

from collections.abc import Mapping, Sequence
import csv

from convseq_ros.errors import ConvseqError
from convseq_ros.evaluation.report.chart import Chart, method_color, method_dash, thinned
from convseq_ros.evaluation.report.summary_table import number
from convseq_ros.evaluation.run_folder import read_table, Run


def read_curve(run: Run) -> tuple[list[float], list[float]]:
    """
    Return recall and precision of a run, both falling in threshold; empty if it has no curve.

    Raises
    ------
    ConvseqError
        If the file does not hold numbers under these two names.

    """
    path = run.folder / 'curve.csv'
    if not path.exists():
        return [], []
    try:
        table = read_table(path, run.reading)
        rows = [(float(row['recall']), float(row['precision'])) for row in table]
    except (KeyError, TypeError, ValueError, csv.Error):
        raise ConvseqError(
            f'{path}: not a precision-recall curve; run `convseq evaluate` again'
        ) from None
    return [row[0] for row in rows], [row[1] for row in rows]


def curves_chart(runs: Sequence[Run], colors: Mapping[str, int]) -> Chart:
    """Return precision against recall, one curve for each method; the first lies on top."""
    name = runs[0].set
    label = f'Precision against recall on {name}; one curve for each of {len(runs)} methods'
    chart = Chart(545, 412, label, name)
    axes = chart.plane((48, 28, 480, 340), 'precision', 'recall', xlim=(0, 1), ylim=(0, 1))
    for place, run in enumerate(runs):
        recall, precision = read_curve(run)
        if recall:
            (line,) = axes.plot(
                thinned([0.0, *recall]),
                thinned([precision[0], *precision]),
                label=run.method,
                color=method_color(colors[run.method]),
                linestyle=method_dash(colors[run.method]),
                linewidth=1.8,
                clip_on=False,
                zorder=3 - place / len(runs),
            )
            auc = number(run.summary.get('auc_pr'))
            told = run.method if auc is None else f'{run.method}: AUC-PR {auc:.3f}'
            chart.mark(line, run.method, told)
    chart.add_legend(axes)
    return chart
