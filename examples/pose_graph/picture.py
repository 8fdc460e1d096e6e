# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The drive before and after, its closures, and what false ones cost."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from comparison import error_m, Trial, true_path, Truth
from graph import Closure, Odometry, Solution
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
import numpy as np
import numpy.typing as npt
from trajectory_error import aligned

_DARK, _PANEL, _PALE, _DIM = '#0f1720', '#16212c', '#e8eef4', '#9fb0c0'
_TRUE, _BEFORE, _AFTER = '#c9d4de', '#f5a623', '#4ea8ff'
_KEPT, _REJECTED = '#4ade80', '#ff6b6b'


def draw_picture(
    path: Path,
    odometry: Odometry,
    solution: Solution,
    closures: Sequence[Closure],
    truth: Truth,
    trials: Sequence[Trial],
    told: str,
) -> None:
    """Write a PNG, 1600 x 900: both paths with the closures, beside the errors; `told` above."""
    figure = Figure(figsize=(16, 9), dpi=100, facecolor=_DARK)
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(
        2,
        2,
        width_ratios=(1.25, 1),
        left=0.055,
        right=0.975,
        top=0.86,
        bottom=0.085,
        wspace=0.13,
        hspace=0.22,
    )
    real = true_path(solution, truth)
    before_m, after_m = error_m(solution, truth, before=True), error_m(solution, truth)
    drawn = _placed(odometry, closures, solution.kept)
    panels = (
        (solution.before, _BEFORE, f'odometry alone: {before_m:.1f} m off, and what it was told'),
        (solution.after, _AFTER, f'corrected by the closures: {after_m:.1f} m off'),
    )
    for row, (poses, colour, title) in enumerate(panels):
        axes = _axes(figure, grid[row, 0], title)
        moved = aligned(poses[:, :2], real)
        axes.plot(*real.T, color=_TRUE, linewidth=5, alpha=0.28, solid_capstyle='round')
        axes.plot(*moved.T, color=colour, linewidth=1.8)
        _draw_closures(axes, moved, drawn)
        axes.plot(*moved[0], 'o', color=_PALE, markersize=7)
        axes.set_aspect('equal', adjustable='datalim')
        axes.set_ylabel('y, m', color=_DIM, fontsize=12)
    axes.set_xlabel('x, m', color=_DIM, fontsize=12, loc='right', labelpad=-15)
    _legend(figure, solution.kept)
    _bars(_axes(figure, grid[:, 1], 'what false closures cost'), trials, before_m)
    figure.text(
        0.04,
        0.945,
        'Loop closures of vpr_node in a GTSAM pose graph, live over ROS topics',
        color=_PALE,
        fontsize=21,
        weight='bold',
    )
    figure.text(0.04, 0.91, told, color=_DIM, fontsize=14)
    figure.savefig(path, facecolor=_DARK)


def _axes(figure: Any, cell: Any, title: str) -> Any:
    axes = figure.add_subplot(cell, facecolor=_PANEL)
    axes.set_title(title, color=_PALE, fontsize=15, loc='left', pad=9)
    axes.tick_params(colors=_DIM, labelsize=11)
    for spine in axes.spines.values():
        spine.set(color='#2c3a48')
    return axes


def _placed(
    odometry: Odometry, closures: Sequence[Closure], kept: Sequence[bool]
) -> list[tuple[int, int, bool]]:
    """Return the keyframes of closures within the odometry, and whether they were kept."""
    found = []
    for closure, inlier in zip(closures, kept, strict=True):
        query, reference = odometry.place(closure.query_ns), odometry.place(closure.reference_ns)
        if query and reference:
            found.append((query[0], reference[0], inlier))
    return found


def _draw_closures(
    axes: Any, path: npt.NDArray[np.float64], closures: Sequence[tuple[int, int, bool]]
) -> None:
    for query, reference, inlier in closures:
        ends = path[[query, reference]]
        if inlier:
            axes.plot(*ends.T, '-o', color=_KEPT, linewidth=1.3, markersize=3.5, zorder=4)
        else:
            axes.plot(
                *ends.T,
                '--',
                color=_REJECTED,
                linewidth=1.4,
                alpha=0.85,
                zorder=3,
                marker='x',
                markersize=6,
            )


def _legend(figure: Any, kept: Sequence[bool]) -> None:
    handles = [
        Line2D([], [], color=_TRUE, alpha=0.4, linewidth=5, label='truth'),
        Line2D([], [], color=_BEFORE, linewidth=2, label='before'),
        Line2D([], [], color=_AFTER, linewidth=2, label='after'),
        Line2D([], [], color=_KEPT, marker='o', label=f'{sum(kept)} closures kept'),
        Line2D(
            [],
            [],
            color=_REJECTED,
            marker='x',
            linestyle='--',
            label=f'{len(kept) - sum(kept)} rejected',
        ),
    ]
    figure.legend(
        handles=handles,
        loc='lower left',
        bbox_to_anchor=(0.035, 0.005),
        ncols=5,
        frameon=False,
        fontsize=13,
        labelcolor=_PALE,
        handlelength=1.8,
        columnspacing=1.8,
    )


def _bars(axes: Any, trials: Sequence[Trial], before_m: float) -> None:
    counts = sorted({trial.false for trial in trials})
    for robust, colour, shift, label in (
        (False, _REJECTED, -0.2, 'believing every closure (Levenberg-Marquardt)'),
        (True, _KEPT, 0.2, 'graduated non-convexity'),
    ):
        chosen = [next(t for t in trials if (t.false, t.robust) == (c, robust)) for c in counts]
        middle = np.array([trial.median_m for trial in chosen])
        low = middle - [min(trial.errors_m) for trial in chosen]
        high = np.array([max(trial.errors_m) for trial in chosen]) - middle
        at = np.arange(len(counts)) + shift
        axes.bar(at, middle, width=0.38, color=colour, alpha=0.9, label=label, zorder=2)
        axes.errorbar(
            at,
            middle,
            yerr=(low, high),
            fmt='none',
            ecolor=_PALE,
            elinewidth=1.4,
            capsize=5,
            zorder=3,
        )
        for x, value, above in zip(at, middle, high, strict=True):
            axes.text(
                x, (value + above) * 1.06, f'{value:.1f}', ha='center', color=_PALE, fontsize=12
            )
    axes.axhline(before_m, color=_BEFORE, linestyle='--', linewidth=1.6, zorder=1)
    axes.text(
        -0.42, before_m * 1.08, f'odometry\nalone {before_m:.1f}', color=_BEFORE, fontsize=12
    )
    axes.set_yscale('log')
    axes.set_ylim(0.5, 250)
    axes.set_yticks((1, 3, 10, 30, 100), ('1', '3', '10', '30', '100'))
    axes.minorticks_off()
    axes.set_xticks(range(len(counts)), [str(count) for count in counts])
    axes.set_xlabel('false closures added to the right ones of vpr_node', color=_PALE, fontsize=13)
    axes.set_ylabel('trajectory error, m (median, lowest to highest)', color=_PALE, fontsize=13)
    axes.grid(axis='y', color='#2c3a48', linewidth=0.8, zorder=0)
    axes.legend(loc='upper left', frameon=False, fontsize=12.5, labelcolor=_PALE)
