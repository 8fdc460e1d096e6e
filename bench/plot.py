# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The picture of cost against map size."""

from collections.abc import Mapping, Sequence
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
