# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The matrix of scores, with the truth and the matches over it."""

from typing import Any

import numpy as np
import numpy.typing as npt

NIGHT = ('#0b1622', '#123350', '#1f5f8b', '#5fa3cf', '#dcecf8')  # low scores to high
UNSCORED = '#4c4c4c'
EDGE = '#0f1720'
VERDICT_COLORS = {'right': '#4ade80', 'wrong': '#ff6b6b', 'rejected': '#f5bd4f'}
MOST_CELLS = 320
MOST_DOTS = 1500
DENSE = 500  # from here on dots have no edge, which would hide their neighbours
_NUM_SHADES = 64


def show_scores(axes: Any, scores: npt.NDArray[np.float32]) -> None:
    """
    Draw scores, shape (Q, R): brighter is more similar, gray where nothing was scored (NaN).

    Of a large matrix each block shows its highest score, so that a thin path survives.
    """
    from matplotlib.colors import LinearSegmentedColormap

    num_queries, num_references = scores.shape
    small = reduced(scores)
    known = small[np.isfinite(small)]
    low, high = np.percentile(known, (1, 99.8)) if known.size else (0.0, 1.0)
    shades = LinearSegmentedColormap.from_list('night', NIGHT, _NUM_SHADES)
    axes.imshow(
        np.ma.masked_invalid(small),
        cmap=shades.with_extremes(bad=UNSCORED),
        vmin=low,
        vmax=high if high > low else low + 1,
        extent=(-0.5, num_references - 0.5, num_queries - 0.5, -0.5),
        aspect='auto',
        interpolation='none',
    )
    if known.size < small.size:
        axes.plot([], [], 's', color=UNSCORED, label='not scored')


def show_truth(axes: Any, truth: npt.NDArray[np.bool_]) -> None:
    """Draw the edge of the right pairs; `truth` is bool, shape (Q, R)."""
    small = reduced(truth.astype(np.float32))
    if small.any() and not small.all() and min(small.shape) > 1:
        rows, columns = (
            (np.arange(few) + 0.5) * all_ / few - 0.5
            for few, all_ in zip(small.shape, truth.shape, strict=True)
        )
        axes.contour(columns, rows, small, levels=[0.5], colors='white', linewidths=0.8)
        axes.plot([], [], color='white', label='white: edge of the truth')


def show_matches(
    axes: Any, matches: npt.NDArray[np.int_], verdicts: npt.NDArray[np.str_], size: float
) -> None:
    """
    Draw a dot for each match, or for every n-th where there are very many.

    `matches` (N, 2) are query and reference, `verdicts` (N,) 'right', 'wrong' or 'rejected',
    `size` is the width of a dot in points.
    """
    step = max(1, -(-len(matches) // MOST_DOTS))
    for verdict in reversed(VERDICT_COLORS):
        chosen = matches[verdicts == verdict]
        if len(chosen):
            axes.plot(
                chosen[::step, 1],
                chosen[::step, 0],
                'o',
                color=VERDICT_COLORS[verdict],
                markeredgecolor=EDGE,
                markeredgewidth=0.6 * (len(matches) < DENSE),
                markersize=size,
                label=f'{len(chosen)} {verdict}',
            )


def reduced(values: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Return the highest value of each block, so that neither side is longer than MOST_CELLS."""
    for axis in (0, 1):
        block = -(-values.shape[axis] // MOST_CELLS)
        if block > 1:
            starts = np.arange(0, values.shape[axis], block)
            values = np.fmax.reduceat(values, starts, axis=axis)
    return values
