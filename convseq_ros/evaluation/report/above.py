# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A map and a drive from above, as SVG: drives as lines, matches as arcs."""

from collections.abc import Sequence
from html import escape
import math

from convseq_ros.core.types import Doubles
import numpy as np

Line = tuple[str, Doubles]  # a name, and points (n, 2) in metres; NaN where unknown
Arc = tuple[int, str, Doubles]  # a match's position on the strip, colour, and two points (2, 2)
_WIDTH, _BORDER = 1000, 30
_FLATTEST, _HIGHEST = 0.15, 0.7  # ratios of height to width
_BENT = 0.2  # offset of an arc's middle, relative to its chord
_COLORS = '#1c7ed6', '#8595a5', '#b08968', '#7a9e7e', '#a37ba8', '#c08497'


def drawn_above(lines: Sequence[Line], arcs: Sequence[Arc]) -> str:
    """Return a drawing with its legend, as HTML; empty if no point is known."""
    lines = [line for line in lines if np.isfinite(line[1]).any()]
    if not lines:
        return ''
    points = np.vstack([points for _, points in lines])
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    width_m, height_m = np.maximum(high - low, 0.1)
    scale = min((_WIDTH - 2 * _BORDER) / width_m, _HIGHEST * _WIDTH / height_m)
    height = max(scale * height_m, _FLATTEST * _WIDTH) + 2 * _BORDER

    def path(points: Doubles) -> list[str]:
        drawn = (points - (low + high) / 2) * (scale, -scale) + (_WIDTH / 2, height / 2)
        return [f'{x:.1f} {y:.1f}' for x, y in drawn.tolist()]

    parts, legend = [], []
    for number, (name, points) in enumerate(lines):
        color, known = _COLORS[number % len(_COLORS)], points[np.isfinite(points).all(axis=1)]
        parts.append(f'<path class="line" stroke="{color}" d="M{"L".join(path(known))}"/>')
        legend.append(f'<span><i style="background:{color}"></i>{escape(name)}</span>')
    for position, color, ends in arcs:
        if np.isfinite(ends).all():
            x, y = ends[1] - ends[0]
            aside = ends.mean(axis=0) + _BENT * np.array((-y, x))
            start, middle, end = path(np.array((ends[0], aside, ends[1])))
            parts.append(
                f'<path class="arc" stroke="{color}" data-frame="{position}" '
                f'd="M{start}Q{middle} {end}"/>'
            )
    unit = 10.0 ** math.floor(math.log10(_WIDTH / scale / 5))
    bar = f'<path class="bar" d="M10 {height - 10:.0f}h{unit * scale:.0f}"/>'
    bar += f'<text x="10" y="{height - 18:.0f}">{unit:g} m</text>'
    return (
        f'<svg id="above" role="img" aria-label="from above" viewBox="0 0 {_WIDTH} {height:.0f}">'
        f'{"".join(parts)}{bar}</svg><p class="legend">{"".join(legend)}</p>'
    )
