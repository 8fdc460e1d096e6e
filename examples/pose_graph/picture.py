# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Draws the drive before and after the correction, its closures, and the cost of false ones."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from comparison import aligned, error_m, Trial, true_path, Truth
from convseq_ros.evaluation.plots import EDGE, new_figure, VERDICT_COLORS
from graph import Closure, Odometry, Solution
from matplotlib import rc_context
import numpy as np
import numpy.typing as npt

_PALE, _DIM, _LINES = '#e8eef4', '#9fb0c0', '#2c3a48'
_TRUE, _BEFORE, _AFTER = '#c9d4de', '#f5a623', '#4ea8ff'
_KEPT, _REJECTED = VERDICT_COLORS['right'], VERDICT_COLORS['wrong']
_STYLE = {
    'savefig.facecolor': EDGE, 'axes.facecolor': '#16212c',
    'text.color': _PALE, 'axes.labelcolor': _DIM, 'xtick.color': _DIM, 'ytick.color': _DIM,
    'axes.edgecolor': _LINES, 'grid.color': _LINES, 'axes.titlelocation': 'left',
    'axes.titlesize': 15, 'axes.labelsize': 12, 'legend.frameon': False, 'legend.fontsize': 12,
}  # fmt: skip


def draw_picture(
    path: Path,
    odometry: Odometry,
    solution: Solution,
    closures: Sequence[Closure],
    truth: Truth,
    trials: Sequence[Trial],
    subtitle: str,
) -> None:
    """Write a PNG, 1600 x 900: both paths with the closures beside the errors, and a subtitle."""
    with rc_context(_STYLE):
        figure = new_figure(16, 9, EDGE)
        figure.set_layout_engine('constrained', w_pad=0.15)
        figure.suptitle(
            f'Loop closures of vpr_node in a GTSAM pose graph, live over ROS topics\n{subtitle}',
            size=15,
        )
        panels = figure.subplot_mosaic([['before', 'cost'], ['after', 'cost']])
        real = true_path(solution, truth)
        before_m, after_m = error_m(solution, truth, before=True), error_m(solution, truth)
        drawn = _placed(odometry, closures, solution.kept)
        panels['before'].set_title(f'odometry alone: {before_m:.1f} m off, with the closures')
        panels['after'].set_title(f'corrected by the closures: {after_m:.1f} m off')
        for name, poses, colour in (
            ('before', solution.before, _BEFORE),
            ('after', solution.after, _AFTER),
        ):
            axes, moved = panels[name], aligned(poses[:, :2], real)
            axes.plot(*real.T, color=_TRUE, linewidth=5, alpha=0.28, label='truth')
            axes.plot(*moved.T, color=colour, linewidth=1.8, label=name)
            _draw_closures(axes, moved, drawn)
            axes.set_aspect('equal', adjustable='datalim')
            axes.set_xlabel('x, m', loc='right')
            axes.set_ylabel('y, m')
            axes.legend(ncols=4, loc='upper left', bbox_to_anchor=(0, -0.06))
        _bars(panels['cost'], trials, before_m)
        figure.savefig(path)


def _placed(
    odometry: Odometry, closures: Sequence[Closure], kept: Sequence[bool]
) -> list[tuple[int, int, bool]]:
    """Return the keyframe pairs of closures within the odometry, and whether they were kept."""
    placed = []
    for closure, inlier in zip(closures, kept, strict=True):
        query, reference = odometry.place(closure.query_ns), odometry.place(closure.reference_ns)
        if query and reference:
            placed.append((query[0], reference[0], inlier))
    return placed


def _draw_closures(
    axes: Any, path: npt.NDArray[np.float64], closures: Sequence[tuple[int, int, bool]]
) -> None:
    for inlier, colour, style, label_text in (
        (True, _KEPT, 'o-', 'closures kept'),
        (False, _REJECTED, 'x--', 'rejected'),
    ):
        pairs = [[query, reference] for query, reference, kept in closures if kept == inlier]
        for number, pair in enumerate(pairs):
            label = '' if number else f'{len(pairs)} {label_text}'
            axes.plot(*path[pair].T, style, color=colour, linewidth=1.3, markersize=4, label=label)


def _bars(axes: Any, trials: Sequence[Trial], before_m: float) -> None:
    counts = sorted({trial.false for trial in trials})
    for robust, colour, shift, label in (
        (False, _REJECTED, -0.2, 'believing every closure (Levenberg-Marquardt)'),
        (True, _KEPT, 0.2, 'graduated non-convexity'),
    ):
        chosen = [next(t for t in trials if (t.false, t.robust) == (c, robust)) for c in counts]
        medians = np.array([trial.median_m for trial in chosen])
        low = medians - [min(trial.errors_m) for trial in chosen]
        high = np.array([max(trial.errors_m) for trial in chosen]) - medians
        at = np.arange(len(counts)) + shift
        bars = axes.bar(
            at, medians, 0.38, yerr=(low, high), color=colour, ecolor=_PALE, label=label
        )
        axes.bar_label(bars, fmt='%.1f')
    axes.axhline(before_m, color=_BEFORE, linestyle='--', label=f'odometry alone {before_m:.1f}')
    axes.set_yscale('log')
    axes.set_ylim(0.5, 250)
    axes.set_yticks((1, 3, 10, 30, 100), ('1', '3', '10', '30', '100'))
    axes.minorticks_off()
    axes.set_xticks(range(len(counts)), [str(count) for count in counts])
    axes.set_title('what false closures cost')
    axes.set_xlabel('false closures added to the right ones of vpr_node')
    axes.set_ylabel('trajectory error, m (median, lowest to highest)')
    axes.grid(axis='y')
    axes.set_axisbelow(True)
    axes.legend(loc='upper left')
