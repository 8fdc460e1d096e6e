# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How often each confidence was right, on one data set."""

from collections.abc import Mapping, Sequence
from html import escape
import math
from typing import Any

from convseq_ros.evaluation.report import charts
from convseq_ros.evaluation.report.charts import line, Plane
from convseq_ros.evaluation.run_folder import Run

_LARGEST = 9.0
_SMALLEST = 2.5


def reliability_table(run: Run) -> list[Mapping[str, Any]]:
    """
    Return the reliability of a run's confidence, range by range; see `calibration`.

    With settings from the other places where there are any, otherwise as it was said.
    """
    kept = run.summary.get('calibration') or {}
    return list(kept.get('from_others') or kept.get('as_shipped') or ())


def reliability_chart(runs: Sequence[Run], colors: Mapping[str, int]) -> str:
    """Return the share of right answers over the confidence; empty if no method has one."""
    told = [(run, reliability_table(run)) for run in runs]
    told = [(run, table) for run, table in told if table]
    if not told:
        return ''
    plane = Plane(48, 28, 340, 340, (0, 1), (0, 1))
    body = charts.axes(plane, 'confidence', 'share that is right')
    body.append(line(plane, (0, 0), (1, 1), 'grid'))
    for run, table in reversed(told):
        style = charts.method_style(colors[run.method])
        points = plane.points([row['said'] for row in table], [row['right'] for row in table])
        body.append(f'<polyline points="{points}" class="series {style}"/>')
        body += [_dot(plane, run, row, style) for row in table]
    label = f'Share of right answers over confidence on {runs[0].set}'
    return charts.svg(405, 412, label, body)


def _dot(plane: Plane, run: Run, row: Mapping[str, Any], style: str) -> str:
    x, y = plane.at(row['said'], row['right'])
    radius = min(_LARGEST, _SMALLEST + math.sqrt(row['count']) / 3)
    text = (
        f'{run.method}: {row["count"]} frames at {row["low"]:g} to {row["high"]:g}, mean '
        f'{row["said"]:.3f}; {row["right"]:.3f} right'
    )
    return (
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" class="bar {style}"'
        f' data-series="{escape(run.method)}"><title>{escape(text)}</title></circle>'
    )
