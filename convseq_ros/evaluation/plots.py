# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figures as PNG and SVG; matplotlib is imported only when one is drawn."""

from collections.abc import Iterable, Mapping, Sequence
import os
from pathlib import Path
import re
from typing import Any, TypeAlias

from convseq_ros.errors import ConvseqError
import cv2
import numpy as np
import numpy.typing as npt

Image: TypeAlias = npt.NDArray[np.uint8]
Pair: TypeAlias = tuple[Image, Image, str, bool]

DARK, PALE, DIM = '#0f1720', '#e8eef4', '#9fb0c0'
RIGHT, WRONG = '#4ade80', '#ff6b6b'
NIGHT = ('#0b1622', '#123350', '#1f5f8b', '#5fa3cf', '#dcecf8')  # low scores to high
MOST_PAIRS = 4


def new_figure(width: float, height: float, face: str = 'white') -> Any:
    """Return an empty matplotlib figure, inches; ConvseqError if matplotlib is not installed."""
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        raise ConvseqError('figures need matplotlib: pip install matplotlib') from None
    figure = Figure(figsize=(width, height), dpi=100, facecolor=face)
    FigureCanvasAgg(figure)
    return figure


def save(figure: Any, *paths: Path) -> None:
    """Write a figure in the format that each name ends with; a file is complete or absent."""
    for path in paths:
        part = path.with_name(path.name + '.part')
        kind = path.suffix[1:]
        undated = {'Date': None} if kind == 'svg' else None
        figure.savefig(part, format=kind, facecolor=figure.get_facecolor(), metadata=undated)
        os.replace(part, path)


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

    Parameters
    ----------
    path : Path
        The picture.
    pairs : sequence of (query, match, caption, right)
        Up to four are drawn. Images are uint8, BGR (H, W, 3) or gray (H, W); the caption is
        'query 57 | reference 60' (a bar, slash or arrow parts the two sides) or one text.
    scores : ndarray of float32, shape (Q, R)
        Query by reference; NaN where nothing was scored.
    truth : ndarray of int, shape (Q,)
        The right reference of each query, -1 for none.
    found : ndarray of int, shape (Q,)
        The accepted reference of each query, -1 for none.
    title : str
        Heading.
    tolerance : int
        References by which a match may miss the truth and still be drawn as right.

    """
    figure = new_figure(16, 9, DARK)
    heading = figure.text(0.03, 0.945, title, color=PALE, weight='bold', size=22, va='center')
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
            _show_image(axes, image, RIGHT if right else WRONG)
            text = sides[column] if column < len(sides) else ''
            axes.set_xlabel(text, color=DIM, fontsize=12, loc='left', labelpad=5)
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


def draw_curves(
    paths: Sequence[Path],
    title: str,
    curves: Mapping[str, tuple[Sequence[float], Sequence[float]]],
) -> None:
    """Draw precision against recall, one curve (recall, precision) for each method."""
    figure = _new_figure_for(curves, 5, 0.8)
    axes = figure.add_subplot(title=title, xlabel='recall', ylabel='precision')
    for index, (name, (recall, precision)) in enumerate(curves.items()):
        if len(recall):
            axes.plot(
                [0.0, *recall],
                [precision[0], *precision],
                label=name,
                color=f'C{index % 10}',
                linestyle='--' if index >= 10 else '-',
                linewidth=1.5,
            )
    axes.set(xlim=(0, 1.01), ylim=(0, 1.02))
    axes.grid(alpha=0.3)
    if any(len(recall) for recall, _ in curves.values()):
        axes.legend(loc='upper left', bbox_to_anchor=(1.01, 1), fontsize=8, frameon=False)
    figure.set_layout_engine('constrained')
    save(figure, *paths)


def draw_accuracies(
    paths: Sequence[Path],
    title: str,
    bars: Sequence[tuple[str, float, float | None, float | None]],
) -> None:
    """Draw a bar for each (method, accuracy, low, high); no whisker where an end is None."""
    figure = _new_figure_for([bar[0] for bar in bars], 1.2 + 0.3 * len(bars), 0.0)
    axes = figure.add_subplot(title=title, xlabel='accuracy, matched queries')
    for place, (name, value, low, high) in enumerate(bars):
        axes.barh(place, value, color=f'C{place % 10}', height=0.65, label=name)
        if low is not None and high is not None:
            axes.plot([low, high], [place, place], color='black', linewidth=1.2, marker='|')
        axes.text(1.015, place, f'{value:.3f}', va='center', fontsize=9)
    axes.set_yticks(range(len(bars)), [bar[0] for bar in bars])
    axes.set(xlim=(0, 1))
    axes.invert_yaxis()
    axes.spines[['top', 'right']].set_visible(False)
    figure.set_layout_engine('constrained')
    save(figure, *paths)


def _new_figure_for(labels: Iterable[str], height: float, heading: float) -> Any:
    """Return a figure that leaves room for a column of labels beside its axes, inches."""
    lengths = [len(label) for label in labels]
    return new_figure(
        5.5 + 0.09 * max(lengths, default=0), max(height, heading + 0.18 * len(lengths))
    )


def draw_reliability(
    paths: Sequence[Path], title: str, curves: Mapping[str, Sequence[Mapping[str, float]]]
) -> None:
    """Draw how often a confidence was right, one table of `calibration` for each method."""
    figure = _new_figure_for(curves, 5, 0.8)
    axes = figure.add_subplot(title=title, xlabel='confidence', ylabel='share that is right')
    axes.plot([0, 1], [0, 1], color='gray', linestyle='--', linewidth=1)
    for name, table in curves.items():
        said, right = [row['said'] for row in table], [row['right'] for row in table]
        (drawn,) = axes.plot(said, right, linewidth=1.2, label=name)
        sizes = [12 + 4 * row['count'] ** 0.5 for row in table]
        axes.scatter(said, right, s=sizes, color=drawn.get_color(), zorder=3)
    axes.set(xlim=(-0.02, 1.02), ylim=(-0.02, 1.02))
    axes.grid(alpha=0.3)
    axes.legend(loc='upper left', bbox_to_anchor=(1.01, 1), fontsize=8, frameon=False)
    figure.set_layout_engine('constrained')
    save(figure, *paths)


def draw_matrix(
    paths: Sequence[Path],
    title: str,
    scores: npt.NDArray[np.float32],
    truth: npt.NDArray[np.bool_] | None,
    found: npt.NDArray[np.int_],
    right: npt.NDArray[np.bool_],
) -> None:
    """
    Draw scores (Q, R) with the edge of truth (Q, R) and the path found (Q,), -1 for none.

    `right`, shape (Q,), says which of the matches found are right.
    """
    figure = new_figure(6.4, 6.4)
    axes = figure.add_subplot(title=title, xlabel='reference', ylabel='query')
    _show_scores(axes, scores)
    if truth is not None and truth.any() and min(truth.shape) > 1:
        axes.contour(truth.astype(float), levels=[0.5], colors='white', linewidths=0.8)
    _show_path(axes, found, right & (found >= 0), 9)
    if (found >= 0).any():
        axes.legend(loc='lower left', fontsize=8)
    figure.set_layout_engine('constrained')
    save(figure, *paths)


def draw_lengths(
    paths: Sequence[Path],
    title: str,
    lengths: Sequence[int],
    entropy: Sequence[float],
    threshold: float | None,
) -> None:
    """Draw sequence length over time above the entropy of the images; NaN where there is none."""
    figure = new_figure(9, 4)
    upper, lower = figure.subplots(2, 1, sharex=True)
    upper.step(range(len(lengths)), lengths, where='post', linewidth=1.5)
    upper.set(title=title, ylabel='sequence length k', ylim=(0, None))
    lower.plot(entropy, color='C1', linewidth=1.2)
    if threshold is not None:
        lower.axhline(threshold, color='gray', linestyle='--', linewidth=1)
    lower.set(xlabel='query', ylabel='image entropy')
    for axes in (upper, lower):
        axes.grid(alpha=0.3)
    figure.set_layout_engine('constrained')
    save(figure, *paths)


def _show_matrix(
    axes: Any,
    scores: npt.NDArray[np.float32],
    truth: npt.NDArray[np.int_],
    found: npt.NDArray[np.int_],
    tolerance: int,
) -> None:
    axes.set_facecolor(DARK)
    _show_scores(axes, scores)
    line = np.where(truth >= 0, truth, np.nan)
    axes.plot(line, np.arange(len(truth)), color='white', linewidth=1.2, label='truth')
    _show_path(axes, found, (found >= 0) & (truth >= 0) & (abs(found - truth) <= tolerance), 20)
    axes.set_xlabel('reference', color=PALE, fontsize=14)
    axes.set_ylabel('query', color=PALE, fontsize=14)
    axes.tick_params(colors=DIM, labelsize=11)
    for spine in axes.spines.values():
        spine.set(color=DIM, linewidth=0.8)
    axes.legend(
        loc='lower left',
        bbox_to_anchor=(0, 1.005),
        ncols=3,
        frameon=False,
        fontsize=12,
        labelcolor=PALE,
        borderaxespad=0,
        handletextpad=0.5,
        columnspacing=1.8,
        markerscale=1.6,
        handlelength=1.4,
    )


def _show_scores(axes: Any, scores: npt.NDArray[np.float32]) -> None:
    from matplotlib.colors import LinearSegmentedColormap

    finite = scores[np.isfinite(scores)]
    low, high = np.percentile(finite, (1, 99.8)) if finite.size else (0.0, 1.0)
    night = LinearSegmentedColormap.from_list('night', NIGHT)
    axes.imshow(scores, cmap=night, vmin=low, vmax=high, aspect='auto', interpolation='nearest')


def _show_path(
    axes: Any, found: npt.NDArray[np.int_], right: npt.NDArray[np.bool_], size: float
) -> None:
    queries = np.arange(len(found))
    wrong = (found >= 0) & ~right
    for chosen, color, label in ((right, RIGHT, 'right'), (wrong, WRONG, 'wrong')):
        if chosen.any():
            axes.scatter(
                found[chosen],
                queries[chosen],
                s=size,
                color=color,
                edgecolor=DARK,
                linewidth=0.6,
                label=f'{chosen.sum()} {label}',
                zorder=3,
            )
