# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sequence length over time, beside the entropy that it follows."""

from collections.abc import Sequence
import math

from convseq_ros.evaluation.report.chart import Chart, COLORS, thinned
from convseq_ros.evaluation.report.summary_table import number
from convseq_ros.evaluation.report.verdict import Seen
from convseq_ros.evaluation.run_folder import Run

WIDTH = 1000
_MOST_TICKS = 800


def lengths_chart(run: Run, seen: Sequence[Seen]) -> Chart | None:
    """
    Return k above entropy, sharing the query axis; wrong candidates are ticks between them.

    None where the length is not worth a chart: it stays the same, or there is more than one pass.
    """
    if len({one.length for one in seen if one.length}) < 2 or any(one.half for one in seen):
        return None
    longest = max(one.length for one in seen)
    label = (
        f'Sequence length of {run.method} over {run.set}, up to {longest}, and the entropy of'
        ' each query image'
    )
    chart = Chart(WIDTH, 310, label, f'{run.set}: {run.method}')
    span = {'xlim': (seen[0].query, max(seen[-1].query, 1))}
    upper = chart.plane((48, 24, WIDTH - 60, 105), 'sequence length k', '', **span)
    upper.set_ylim(0, longest * 1.08)
    upper.tick_params(labelbottom=False)
    upper.yaxis.get_major_locator().set_params(nbins=5, integer=True)
    queries = thinned([one.query for one in seen])
    upper.step(
        queries,
        thinned([one.length for one in seen]),
        where='post',
        color=COLORS['c0'],
        linewidth=1.8,
    )
    between = upper.get_xaxis_transform()
    for verdict, color in (('rejected', COLORS['rejected']), ('wrong', COLORS['wrong'])):
        wrong = [one.query for one in seen if one.verdict == verdict and not one.correct]
        if wrong:
            upper.plot(
                thinned(wrong, _MOST_TICKS),
                [-0.08] * min(len(wrong), _MOST_TICKS),
                '|',
                color=color,
                markersize=9,
                markeredgewidth=2,
                transform=between,
                clip_on=False,
                label=f'{len(wrong)} wrong, {"accepted" if verdict == "wrong" else verdict}',
            )
    lower = chart.plane((48, 164, WIDTH - 60, 105), 'entropy of the image', 'query', **span)
    lower.yaxis.get_major_locator().set_params(nbins=5)
    lower.plot(
        queries,
        thinned([math.nan if one.entropy is None else one.entropy for one in seen]),
        color=COLORS['c1'],
        linewidth=1.3,
    )
    threshold = entropy_threshold(run)
    if threshold is not None:
        lower.axhline(threshold, color=COLORS['soft'], linestyle='--', linewidth=1)
        lower.annotate(
            f'entropy threshold {threshold:g}',
            (1, threshold),
            (0, 4),
            color=COLORS['soft'],
            size=11,
            ha='right',
            xycoords=('axes fraction', 'data'),
            textcoords='offset points',
        )
    chart.add_legend(upper)
    return chart


def entropy_threshold(run: Run) -> float | None:
    """Return the entropy up to which a sequence grows, ET in the paper, if the run has one."""
    return number(_find(run.summary.get('configuration'), 'entropy_threshold'))


def _find(configuration: object, name: str) -> object:
    if not isinstance(configuration, dict):
        return None
    if name in configuration:
        return configuration[name]
    parts = (_find(part, name) for part in configuration.values())
    return next((value for value in parts if value is not None), None)
