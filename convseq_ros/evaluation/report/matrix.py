# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The similarity matrix of a run, with truth and best candidates drawn over it."""

from collections.abc import Sequence

from convseq_ros.evaluation.plots.matrix import show_matches, show_scores, show_truth
from convseq_ros.evaluation.report.chart import Chart
from convseq_ros.evaluation.report.verdict import Seen
from convseq_ros.evaluation.run_folder import Run
import numpy as np

SIDE = 320.0


def matrix_chart(run: Run, seen: Sequence[Seen]) -> Chart | None:
    """Return the scores of a run with the best candidate of each query; None if it has none."""
    scores, truth = run.scores(), run.truth()
    if scores is None or not scores.size:
        return None
    num_queries, num_references = scores.shape
    height = min(max(SIDE * num_queries / num_references, 0.4 * SIDE), 1.5 * SIDE)
    label = (
        f'Pair scores of {run.method} on {run.set}, {num_queries} x {num_references}: truth and'
        ' found path'
    )
    chart = Chart(SIDE + 54, height + 66, label, f'{run.set}: {run.method}')
    axes = chart.plane((44, 26, SIDE, height), 'query', 'reference')
    axes.grid(visible=False)
    show_scores(axes, scores)
    if truth is not None:
        show_truth(axes, truth)
    matched = [one for one in seen if one.best is not None]
    if matched:
        show_matches(
            axes,
            np.array([(one.query, one.best) for one in matched]),
            np.array([one.verdict for one in matched]),
            size=4.2,
        )
    for axis in (axes.xaxis, axes.yaxis):
        axis.get_major_locator().set_params(nbins=6, integer=True)
    chart.add_legend(axes)
    return chart
