# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How often each confidence was right, on one data set."""

from collections.abc import Mapping, Sequence
import math
from typing import Any

from convseq_ros.evaluation.report.chart import Chart, COLORS, method_color, method_dash
from convseq_ros.evaluation.run_folder import Run

_LARGEST = 18.0
_SMALLEST = 5.0


def reliability_table(run: Run) -> list[Mapping[str, Any]]:
    """
    Return the reliability of a run's confidence, range by range; see `calibration`.

    With settings from the other places where there are any, otherwise as it was said.
    """
    kept = run.summary.get('calibration') or {}
    return list(kept.get('from_others') or kept.get('as_shipped') or ())


def reliability_chart(runs: Sequence[Run], colors: Mapping[str, int]) -> Chart | None:
    """Return the share of right answers over the confidence; None if no method has one."""
    runs = [run for run in runs if reliability_table(run)]
    if not runs:
        return None
    name = runs[0].set
    chart = Chart(545, 412, f'Share of right answers over confidence on {name}', name)
    place = (48, 28, 480, 340)
    axes = chart.plane(place, 'share that is right', 'confidence', xlim=(0, 1), ylim=(0, 1))
    axes.plot([0, 1], [0, 1], color=COLORS['skipped'], linewidth=1)
    for run in reversed(runs):
        table, color = reliability_table(run), method_color(colors[run.method])
        (line,) = axes.plot(
            [row['said'] for row in table],
            [row['right'] for row in table],
            label=run.method,
            color=color,
            linestyle=method_dash(colors[run.method]),
            linewidth=1.8,
            clip_on=False,
        )
        chart.mark(line, run.method, run.method)
        for row in table:
            size = min(_LARGEST, _SMALLEST + math.sqrt(row['count']) / 1.5)
            (dot,) = axes.plot(
                row['said'], row['right'], 'o', color=color, markersize=size, clip_on=False
            )
            told = (
                f'{run.method}: {row["count"]} frames at {row["low"]:g} to {row["high"]:g}, mean '
                f'{row["said"]:.3f}; {row["right"]:.3f} right'
            )
            chart.mark(dot, run.method, told)
    chart.add_legend(axes)
    return chart
