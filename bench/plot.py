# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The pictures of cost against map size, and of a frame by its stages."""

from collections.abc import Mapping, Sequence
from itertools import cycle
from pathlib import Path
from typing import Any

from convseq_ros.evaluation.plots import new_figure, save

from bench.table import in_units

_INK, _DIM, _FAINT = '#1b2733', '#5b6b7a', '#dde4ea'
_LINES = {
    'released script, computed': ('#c0392b', 'released script,\ncomputed'),
    'coherent, exhaustive': ('#d08a1d', 'ours, every reference'),
    'coherent, shortlist': ('#1f6fb2', 'ours, shortlist'),
}
_CAMERAS_HZ = {10: 0.85, 30: 0.15}  # and where along the axis they are named
_LOWEST_MS = 4.0
_STAGE_COLORS = (
    '#1f6fb2', '#6fa8dc', '#9fc5e8', '#2e8b57', '#8cc9a1', '#d08a1d', '#e7b75f', '#c0392b',
    '#8e5ba6', '#c9a6d6', '#7a5c3e', '#5b6b7a', '#b8c4ce',
)  # fmt: skip


def draw_cost(rows: Sequence[Mapping[str, Any]], path: Path) -> bool:
    """
    Draw what a frame costs with maps of all sizes.

    Parameters
    ----------
    rows : sequence of mapping
        Findings of the part `frames`.
    path : Path
        The PNG.

    Returns
    -------
    bool
        False if there is nothing to draw.

    """
    lines = {side: _points(rows, side) for side in _LINES}
    if not any(lines.values()):
        return False
    figure = new_figure(9, 5.4)
    axes = figure.add_axes((0.09, 0.12, 0.7, 0.74))
    axes.set(xscale='log', yscale='log')
    for side, points in lines.items():
        if points:
            color, label = _LINES[side]
            sizes, costs = zip(*points, strict=True)
            axes.plot(
                sizes,
                costs,
                color=color,
                linewidth=2.4,
                marker='o',
                markersize=7,
                markeredgecolor='white',
                markeredgewidth=1.4,
                zorder=3,
            )
            axes.annotate(
                f'{label}\n{in_units(costs[-1])}',
                (sizes[-1], costs[-1]),
                (12, 0),
                textcoords='offset points',
                va='center',
                color=color,
                fontsize=11,
                weight='bold',
            )
    for rate_hz, place in _CAMERAS_HZ.items():
        axes.axhline(1e3 / rate_hz, color=_DIM, linewidth=1, linestyle=(0, (4, 3)), zorder=1)
        axes.annotate(
            f'a camera at {rate_hz} Hz',
            (place, 1e3 / rate_hz),
            (0, 4),
            color=_DIM,
            fontsize=9,
            xycoords=('axes fraction', 'data'),
            textcoords='offset points',
            ha='center',
            zorder=2,
        )
    _dress(figure, axes, rows[0]['threads'])
    path.parent.mkdir(parents=True, exist_ok=True)
    save(figure, path)
    return True


def draw_stages(rows: Sequence[Mapping[str, Any]], path: Path) -> bool:
    """Draw where the time of a frame goes, by findings of the part `stages`; as `draw_cost`."""
    known = [row for row in rows if row['value'] is not None]
    if not known:
        return False
    sizes = list(dict.fromkeys(row['what'] for row in known))
    stages = list(dict.fromkeys(row['side'] for row in known))
    figure = new_figure(9, 1.6 + 0.8 * len(sizes))
    axes = figure.add_axes((0.13, 0.2, 0.62, 0.62))
    ends = dict.fromkeys(sizes, 0.0)
    for stage, color in zip(stages, cycle(_STAGE_COLORS), strict=False):
        took = {row['what']: row['value'] for row in known if row['side'] == stage}
        widths = [took.get(size, 0.0) for size in sizes]
        lefts = [ends[size] for size in sizes]
        labels = [size.rpartition('R = ')[2] for size in sizes]
        axes.barh(labels, widths, left=lefts, color=color, label=stage, edgecolor='white')
        ends = {size: ends[size] + took.get(size, 0.0) for size in sizes}
    axes.invert_yaxis()
    axes.set_xlabel('milliseconds', color=_DIM)
    axes.set_ylabel('references in the map', color=_DIM)
    axes.tick_params(colors=_DIM, length=0)
    for spine in axes.spines.values():
        spine.set_visible(False)
    axes.legend(loc='center left', bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=9)
    title = 'Where the time of a frame goes, on one core'
    figure.text(0.03, 0.93, title, color=_INK, fontsize=13, weight='bold', va='center')
    path.parent.mkdir(parents=True, exist_ok=True)
    save(figure, path)
    return True


def _dress(figure: Any, axes: Any, cores: int) -> None:
    from matplotlib.ticker import FuncFormatter

    axes.xaxis.set_major_formatter(FuncFormatter(lambda size, _: f'{size:,.0f}'))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda cost, _: in_units(cost)))
    axes.set_ylim(bottom=min(axes.get_ylim()[0], _LOWEST_MS))
    axes.minorticks_off()
    axes.grid(color=_FAINT, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.tick_params(colors=_DIM, length=0, labelsize=10)
    for spine in axes.spines.values():
        spine.set_visible(False)
    axes.set_xlabel('references in the map', color=_DIM, fontsize=11, labelpad=8)
    figure.text(
        0.03,
        0.945,
        'What a frame costs, from image to answer',
        color=_INK,
        fontsize=15,
        weight='bold',
        va='center',
    )
    figure.text(
        0.03,
        0.895,
        f'sequences of 10 frames, {cores} core{"s" * (cores > 1)}; both axes logarithmic',
        color=_DIM,
        fontsize=10.5,
        va='center',
    )


def _points(rows: Sequence[Mapping[str, Any]], side: str) -> list[tuple[int, float]]:
    return [
        (int(row['what'].rpartition('R = ')[2].replace(',', '')), row['value'])
        for row in rows
        if row['side'] == side and row['value'] is not None and row['unit'] == 'ms'
    ]
