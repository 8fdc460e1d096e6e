# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sequence length over time, beside the entropy that it follows."""

from collections.abc import Sequence
import math

from convseq_ros.evaluation.report.charts import axes, line, Plane, svg, text, thinned
from convseq_ros.evaluation.report.summary_table import number
from convseq_ros.evaluation.report.verdict import Seen
from convseq_ros.evaluation.run_folder import Run

WIDTH = 1000


def lengths_chart(run: Run, seen: Sequence[Seen]) -> str:
    """Return k above entropy, sharing the query axis; wrong matches are ticks between them."""
    queries = [float(one.query) for one in seen]
    span = (min(queries), max(queries) or 1.0)
    most = max(one.length for one in seen)
    upper = Plane(48, 24, WIDTH - 60, 105, span, (0, most * 1.08))
    body = axes(upper, '', 'sequence length k', (None, 0))
    rising = [x for query in queries for x in (query, query + 1)][:-1]
    lengths = [y for one in seen for y in (float(one.length),) * 2][:-1]
    points = upper.points(thinned(rising, 4000), thinned(lengths, 4000))
    body.append(f'<polyline points="{points}" class="series length"/>')
    body += [
        f'<rect x="{x - 1}" y="132" width="2" height="9" class="{style}"/>'
        for x, style in _mistakes(upper, seen).items()
    ]
    known = [(float(one.query), one.entropy) for one in seen if one.entropy is not None]
    if not known:
        return svg(WIDTH, 150, _label(run, most), body)
    threshold = entropy_threshold(run)
    values = [one[1] for one in known] + ([] if threshold is None else [threshold])
    edges = (math.floor(min(values) * 10) / 10, math.ceil(max(values) * 10) / 10)
    lower = Plane(48, 164, WIDTH - 60, 105, span, edges)
    body += axes(lower, 'query', 'entropy of the image', (0, 2))
    points = lower.points(
        thinned([one[0] for one in known], 2000), thinned([one[1] for one in known], 2000)
    )
    body.append(f'<polyline points="{points}" class="series entropy"/>')
    if threshold is not None:
        body.append(line(lower, (span[0], threshold), (span[1], threshold), 'threshold'))
        body.append(
            text(
                lower.left + lower.width,
                lower.at(0, threshold)[1] - 5,
                f'entropy threshold {threshold:g}',
                'tick',
                'end',
            )
        )
    return svg(WIDTH, 310, _label(run, most), body)


def _mistakes(plane: Plane, seen: Sequence[Seen]) -> dict[int, str]:
    """Return where a best candidate is wrong, one mark a place; an accepted one hides others."""
    marks: dict[int, str] = {}
    for one in seen:
        if one.best is not None and not one.correct:
            place = round(plane.at(one.query, 0)[0])
            marks[place] = one.verdict if marks.get(place) != 'wrong' else 'wrong'
    return marks


def varies(seen: Sequence[Seen]) -> bool:
    """Return whether the sequence length is worth a chart: it changes, over one pass."""
    return len({one.length for one in seen if one.length}) > 1 and not any(
        one.half for one in seen
    )


def entropy_threshold(run: Run) -> float | None:
    """Return the entropy up to which a sequence grows, ET in the paper, if the run has one."""
    return number(_find(run.summary.get('configuration'), 'entropy_threshold'))


def _label(run: Run, most: int) -> str:
    return (
        f'Sequence length of {run.method} over {run.set}, up to {most}, and the entropy of'
        ' each query image'
    )


def _find(configuration: object, name: str) -> object:
    if not isinstance(configuration, dict):
        return None
    if name in configuration:
        return configuration[name]
    parts = (_find(part, name) for part in configuration.values())
    return next((value for value in parts if value is not None), None)
