# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Accuracy bars of one data set."""

from collections.abc import Mapping, Sequence
from typing import Any

from convseq_ros.evaluation.report.chart import Chart, COLORS, method_color, NUM_COLORS
from convseq_ros.evaluation.report.summary_table import number
from convseq_ros.evaluation.run_folder import Run

PITCH = 26


def accuracy(run: Run) -> float:
    """Return the accuracy over matched queries, 0 if nothing was matched."""
    return number(run.summary.get('accuracy_matched')) or 0.0


def interval(run: Run) -> tuple[float, float] | None:
    """Return the ends of the interval of the accuracy, if it has one."""
    low, high = (number(run.summary.get(f'accuracy_matched_{end}')) for end in ('low', 'high'))
    return None if low is None or high is None else (low, high)


def accuracies_chart(runs: Sequence[Run], colors: Mapping[str, int]) -> Chart:
    """Return bars of accuracy over matched queries, with intervals; a tick is over all queries."""
    name = runs[0].set
    told = ', '.join(f'{run.method} {accuracy(run):.3f}' for run in runs)
    chart = Chart(545, 70 + PITCH * len(runs), f'Accuracy on {name}: {told}', name)
    axes = chart.plane(
        (190, 12, 285, PITCH * len(runs)),
        '',
        'accuracy over matched queries; upright tick: over all',
        xlim=(0, 1),
        ylim=(len(runs) - 0.5, -0.5),
    )
    axes.grid(visible=False, axis='y')
    axes.set_yticks(range(len(runs)), [_short(run.method) for run in runs])
    axes.tick_params(axis='y', labelsize=12, labelcolor=COLORS['ink'])
    for place, (run, label) in enumerate(zip(runs, axes.get_yticklabels(), strict=True)):
        for artist in (label, *_bar(axes, place, run, colors[run.method])):
            chart.mark(artist, run.method, f'{run.method}: {_shown(run)}')
    return chart


def _bar(axes: Any, place: int, run: Run, color: int) -> list[Any]:
    from matplotlib.colors import to_rgba

    again = color >= NUM_COLORS
    bars = axes.barh(
        place,
        max(accuracy(run), 0.003),
        height=0.6,
        color=to_rgba(method_color(color), 0.4 if again else 0.85),
        edgecolor=method_color(color) if again else 'none',
        linestyle='--',
    )
    ink = {'color': COLORS['ink'], 'clip_on': False}
    artists = [*bars, axes.text(1.04, place, _shown(run), va='center', size=12, **ink)]
    ends = interval(run)
    if ends:
        artists += axes.plot(ends, (place, place), '|-', linewidth=1.2, markersize=7, **ink)
    everything = number(run.summary.get('accuracy_all'))
    if everything is not None:
        artists += axes.plot(
            everything, place, '|', markersize=20, markeredgewidth=2.5, alpha=0.55, **ink
        )
    return artists


def _shown(run: Run) -> str:
    return '-' if number(run.summary.get('accuracy_matched')) is None else f'{accuracy(run):.3f}'


def _short(name: str, most: int = 27) -> str:
    return name if len(name) <= most else name[: most - 1] + '…'
