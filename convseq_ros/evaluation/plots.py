# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figures by matplotlib, which is imported only to draw one."""

from io import StringIO
from pathlib import Path
from typing import Any, TypeAlias

from convseq_ros.errors import load
from convseq_ros.io.regular_file import complete_or_absent, MARK
import numpy as np
import numpy.typing as npt

Scores: TypeAlias = npt.NDArray[np.float32]  # (Q, R), NaN where nothing was scored
Numbers: TypeAlias = npt.NDArray[np.int_]
_METADATA = {
    'png': {'Comment': MARK},
    'svg': {'Description': MARK, 'Date': None},
    'pdf': {'Subject': MARK, 'CreationDate': None},
}
NIGHT = ('#0b1622', '#123350', '#1f5f8b', '#5fa3cf', '#dcecf8')  # from low to high scores
UNSCORED = '#4c4c4c'
EDGE = '#0f1720'
VERDICT_COLORS = {'right': '#4ade80', 'wrong': '#ff6b6b', 'rejected': '#f5bd4f'}
MOST_CELLS = 320
MOST_DOTS = 1500
DENSE = 500  # from this count on, dots have no edge, which would hide other dots
_NUM_SHADES = 64


def new_figure(width: float, height: float, face: str = 'white') -> Any:
    """Return an empty matplotlib figure, inches; ConvseqError if matplotlib is not installed."""
    canvas = load('matplotlib.backends.backend_agg', 'a figure')
    figure = load('matplotlib.figure', 'a figure')
    figure = figure.Figure(figsize=(width, height), dpi=100, facecolor=face)
    canvas.FigureCanvasAgg(figure)
    return figure


def save(figure: Any, *paths: Path, **options: Any) -> None:
    """Write a figure as png, svg or pdf, by the suffix of each path; bytes are reproducible."""
    for path in paths:
        with complete_or_absent(path) as part:
            _draw(figure, part, path.suffix[1:], **options)


def svg(figure: Any) -> str:
    """Return a figure as SVG, the same each time."""
    _draw(figure, buffer := StringIO(), 'svg', bbox_inches='tight')
    return buffer.getvalue()


def _draw(figure: Any, file: Path | StringIO, kind: str, **options: Any) -> None:
    from matplotlib import rc_context

    # Dollar signs are drawn as they are; the text between two would be parsed as a formula.
    for text in figure.findobj(lambda artist: hasattr(artist, 'set_parse_math')):
        text.set_parse_math(False)
    with rc_context({'svg.hashsalt': 'convseq_ros', 'pdf.fonttype': 42}):
        figure.savefig(file, format=kind, metadata=_METADATA[kind], **options)


def show_scores(axes: Any, scores: Scores) -> None:
    """Draw scores (Q, R): brighter is more similar, gray is NaN; blocks show their maximum."""
    from matplotlib.colors import LinearSegmentedColormap

    num_queries, num_references = scores.shape
    small = reduced(scores)
    finite = small[np.isfinite(small)]
    low, high = np.percentile(finite, (1, 99.8)) if finite.size else (0.0, 1.0)
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
    if finite.size < small.size:
        axes.plot([], [], 's', color=UNSCORED, label='not scored')


def show_truth(axes: Any, truth: npt.NDArray[np.bool_]) -> None:
    """Draw the edge of the right pairs; `truth` is bool, shape (Q, R)."""
    small = reduced(truth.astype(np.float32))
    if small.any() and not small.all() and min(small.shape) > 1:
        rows, columns = (
            (np.arange(count) + 0.5) * total / count - 0.5
            for count, total in zip(small.shape, truth.shape, strict=True)
        )
        axes.contour(columns, rows, small, levels=[0.5], colors='white', linewidths=0.8)
        axes.plot([], [], color='white', label='white: edge of the truth')


def show_matches(axes: Any, matches: Numbers, verdicts: npt.NDArray[np.str_], size: float) -> None:
    """Draw a dot per match (N, 2), `size` points wide; above MOST_DOTS, only every n-th."""
    step = max(1, -(-len(matches) // MOST_DOTS))
    edge = {'markeredgecolor': EDGE, 'markeredgewidth': 0.6 * (len(matches) < DENSE)}
    for verdict in reversed(VERDICT_COLORS):
        queries, references = matches[verdicts == verdict].T
        if len(queries):
            style = {'color': VERDICT_COLORS[verdict], 'markersize': size, **edge}
            label = f'{len(queries)} {verdict}'
            axes.plot(references[::step], queries[::step], 'o', label=label, **style)


def reduced(values: Scores) -> Scores:
    """Return the maximum of each block, so that neither side is longer than MOST_CELLS."""
    for axis in (0, 1):
        block = -(-values.shape[axis] // MOST_CELLS)
        if block > 1:
            starts = np.arange(0, values.shape[axis], block)
            values = np.fmax.reduceat(values, starts, axis=axis)
    return values
