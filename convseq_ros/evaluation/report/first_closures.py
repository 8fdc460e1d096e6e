# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How soon each method knows where it is, on one data set."""

from collections.abc import Mapping, Sequence
from typing import Any

from convseq_ros.evaluation.report.chart import Chart, COLORS, method_color
from convseq_ros.evaluation.report.summary_table import number
from convseq_ros.evaluation.run_folder import Run

_PITCH = 18


def waits(run: Run) -> list[tuple[str, float | None, str]]:
    """Return each part of the map that was kept, frames to the first closure, and words."""
    kept = run.summary.get('frames_to_first_closure')
    metres = run.summary.get('metres_to_first_closure')
    found = []
    for half, frames in kept.items() if isinstance(kept, Mapping) else ():
        wait = number(frames)
        way = number(metres.get(half)) if isinstance(metres, Mapping) else None
        words = [] if wait is None else [f'{wait:g}']
        words += [] if way is None else [f'{way:g} m']
        found.append((str(half), wait, ', '.join(words) or 'none'))
    return found


def first_closures_chart(runs: Sequence[Run], colors: Mapping[str, int]) -> Chart | None:
    """Return bars of the frames to the first right closure; None if none is known of any run."""
    rows = [(run, *one) for run in runs for one in waits(run)]
    if not rows:
        return None
    name, most = runs[0].set, max([1.0, *(frames for _, _, frames, _ in rows if frames)])
    told = ', '.join(f'{run.method} {half} {words}' for run, half, _, words in rows)
    label = f'Frames to the first right closure on {name}: {told}'
    chart = Chart(545, 70 + _PITCH * len(rows), label, name)
    axes = chart.plane(
        (190, 12, 270, _PITCH * len(rows)),
        '',
        'frames from entering the map to the first right closure',
        xlim=(0, most),
        ylim=(len(rows) - 0.5, -0.5),
    )
    axes.grid(visible=False, axis='y')
    axes.set_yticks(range(len(rows)), [f'{run.method} {half}'.strip() for run, half, *_ in rows])
    axes.tick_params(axis='y', labelsize=11, labelcolor=COLORS['ink'])
    for place, (run, half, frames, words) in enumerate(rows):
        for artist in _bar(axes, place, frames, most, words, method_color(colors[run.method])):
            chart.mark(artist, run.method, f'{run.method} {half}: {words}')
    return chart


def _bar(
    axes: Any, place: int, frames: float | None, most: float, words: str, color: str
) -> list[Any]:
    wide = most if frames is None else max(frames, most / 100)
    drawn: list[Any] = list(
        axes.barh(place, wide, height=0.6, color=color, alpha=0.25 if frames is None else 0.85)
    )
    place_of_words = 1.03 * most, place, words
    drawn.append(axes.text(*place_of_words, va='center', size=11, color=COLORS['ink']))
    return drawn
