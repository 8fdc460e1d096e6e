# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The picture of the demo: matched pairs beside the matrix that they were found in."""

from collections.abc import Sequence
from pathlib import Path
import re
from typing import Any, TypeAlias

from convseq_ros.evaluation.plots.figure import new_figure, save
from convseq_ros.evaluation.plots.matrix import EDGE, show_matches, show_scores, VERDICT_COLORS
import cv2
import numpy as np
import numpy.typing as npt

Image: TypeAlias = npt.NDArray[np.uint8]
Pair: TypeAlias = tuple[Image, Image, str, bool]

MOST_PAIRS = 4
_PALE, _DIM = '#e8eef4', '#9fb0c0'


def demo_picture(
    path: Path,
    pairs: Sequence[Pair],
    scores: npt.NDArray[np.float32],
    truth: npt.NDArray[np.int_],
    found: npt.NDArray[np.int_],
    title: str,
    tolerance: int = 2,
) -> None:
    """
    Draw one PNG, 1600 x 900: matched pairs beside the matrix of scores they were found in.

    Up to four pairs are drawn: query and match, uint8 BGR (H, W, 3) or gray (H, W); a caption,
    such as 'query 57 | reference 60', whose sides a bar, slash or arrow parts; and whether it is
    right.
    `scores` (Q, R) is NaN where nothing was scored; `truth` and `found` (Q,) are the right and the
    accepted reference, -1 for none, `tolerance` references apart at most.
    """
    figure = new_figure(16, 9, EDGE)
    heading = figure.text(0.03, 0.945, title, color=_PALE, weight='bold', size=22, va='center')
    heading.set_size(min(22, 22 * 1504 / heading.get_window_extent().width))
    edge = _show_pairs(figure, list(pairs)[:MOST_PAIRS])
    axes = figure.add_axes((edge + 0.075, 0.1, 0.895 - edge, 0.77))
    _show_matrix(axes, scores, truth, found, tolerance)
    save(figure, path)


def _show_pairs(figure: Any, pairs: list[Pair]) -> float:
    """Draw the pairs in rows as large as fit; return where they end, a share of the width."""
    if not pairs:
        return 0.0
    pitch = 0.87 / max(len(pairs), 3)
    aspect = max(image.shape[1] / image.shape[0] for pair in pairs for image in pair[:2])
    height = min(pitch - 0.05, 0.215 * 16 / 9 / aspect)
    width = height * aspect * 9 / 16
    pitch = min(pitch, height + 0.11)
    top = 0.03 + 0.87 - (0.87 - pitch * len(pairs)) / 2
    for row, (query, match, caption, right) in enumerate(pairs):
        sides = re.split(r'\s*(?:[|/\n→]|->)\s*', caption, maxsplit=1)
        for column, image in enumerate((query, match)):
            place = (0.03 + column * (width + 0.008), top - row * pitch - height, width, height)
            axes = figure.add_axes(place, anchor='N')
            _show_image(axes, image, VERDICT_COLORS['right' if right else 'wrong'])
            text = sides[column] if column < len(sides) else ''
            axes.set_xlabel(text, color=_DIM, fontsize=12, loc='left', labelpad=5)
    return 0.038 + 2 * width


def _show_image(axes: Any, image: Image, color: str) -> None:
    if image.ndim == 2:
        axes.imshow(image, cmap='gray', vmin=0, vmax=255, interpolation='antialiased')
    else:
        axes.imshow(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), interpolation='antialiased')
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set(color=color, linewidth=3)


def _show_matrix(
    axes: Any,
    scores: npt.NDArray[np.float32],
    truth: npt.NDArray[np.int_],
    found: npt.NDArray[np.int_],
    tolerance: int,
) -> None:
    axes.set_facecolor(EDGE)
    show_scores(axes, scores)
    line = np.where(truth >= 0, truth, np.nan)
    axes.plot(line, np.arange(len(truth)), color='white', linewidth=1.2, label='truth')
    queries = np.flatnonzero(found >= 0)
    references, wanted = found[queries], truth[queries]
    right = (wanted >= 0) & (abs(references - wanted) <= tolerance)
    show_matches(
        axes, np.stack((queries, references), 1), np.where(right, 'right', 'wrong'), size=4.5
    )
    axes.set_xlabel('reference', color=_PALE, fontsize=14)
    axes.set_ylabel('query', color=_PALE, fontsize=14)
    axes.tick_params(colors=_DIM, labelsize=11)
    for spine in axes.spines.values():
        spine.set(color=_DIM, linewidth=0.8)
    axes.legend(
        loc='lower left',
        bbox_to_anchor=(0, 1.005),
        ncols=4,
        frameon=False,
        fontsize=12,
        labelcolor=_PALE,
        borderaxespad=0,
        handletextpad=0.5,
        columnspacing=1.8,
        markerscale=1.6,
        handlelength=1.4,
    )
