# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The charts of a report, by matplotlib: for the page, and as files for papers and slides."""

from collections.abc import Iterator, Sequence
from html import escape
from io import StringIO
from pathlib import Path
import re
from typing import Any

from convseq_ros.evaluation.plots import (
    new_figure,
    save,
    show_matches,
    show_scores,
    show_truth,
    take_texts_literally,
)
from convseq_ros.evaluation.report.shown import Shown
import numpy as np
import numpy.typing as npt

KINDS = ('png', 'svg', 'pdf')
INK = '#1b2733'  # of files; the page replaces it by the colour of its text
_WIDTH_IN, _HEIGHT_IN, _LEGEND_IN = 5.2, 3.6, 0.17


def set_charts(runs: Sequence[Shown]) -> Iterator[tuple[str, str, Any]]:
    """Yield name, caption and figure of each chart of one set."""
    lines = []
    for one in runs:
        if len(one.curve):
            recall, precision = np.vstack(((0.0, one.curve[0, 1]), one.curve)).T
            lines.append((one.name, recall, precision))
    if lines:
        caption = (
            'Precision and recall: one point for every distinct score. Recall is over matched '
            'queries that have an answer.'
        )
        yield 'curves', caption, _lines(runs, lines, 'recall', 'precision')
    tables = [(one.name, (one.run.summary.get('calibration') or {})) for one in runs]
    said = [
        (name, *(np.array([row[key] for row in table['as_shipped']]) for key in ('said', 'right')))
        for name, table in tables
        if table.get('as_shipped')
    ]
    if said:
        caption = 'Reliability: how often a confidence is right, slips included.'
        figure = _lines(runs, said, 'confidence', 'share that is right', marker='o')
        figure.axes[0].plot((0, 1), (0, 1), color=INK, alpha=0.4, linewidth=1)
        yield 'reliability', caption, figure


def run_charts(one: Shown) -> Iterator[tuple[str, str, Any]]:
    """Yield name, caption and figure of each chart of one run."""
    if one.scores is not None and one.scores.size:
        caption = (
            f'{one.name}: scores of image pairs; brighter is more similar. Between the white '
            'lines: truth. Dots: best candidates.'
        )
        yield 'matrix', caption, _matrix(one, one.scores)
    lengths = {row.length for row in one.rows if row.length}
    if len(lengths) > 1 and not any(row.half for row in one.rows):
        caption = f'{one.name}: frames matched together (k), and the entropy of each image.'
        yield 'lengths', caption, _lengths(one)


def svg(figure: Any, label: str) -> str:
    """Return a figure as SVG for the page; its ink is the colour of the page's text."""
    from matplotlib import rc_context

    take_texts_literally(figure)
    drawn = StringIO()
    nothing = dict.fromkeys(('Creator', 'Date', 'Format', 'Type'))
    with rc_context({'svg.fonttype': 'none', 'svg.hashsalt': label}):
        figure.savefig(drawn, format='svg', metadata=nothing, transparent=True)
    text = drawn.getvalue().replace(INK, 'currentColor')
    return f'<svg role="img" aria-label="{escape(label)}"' + text[text.index('<svg') + 4 :]


def write_figures(runs: Sequence[Shown], folder: Path) -> None:
    """Write the charts of every set and method, .png, .svg and .pdf."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in dict.fromkeys(one.run.set for one in runs):
        own = [one for one in runs if one.run.set == name]
        charts = [(name, what, figure) for what, _, figure in set_charts(own)]
        for one in own:
            charts += [(f'{name}-{one.name}', what, figure) for what, _, figure in run_charts(one)]
        for start, what, figure in charts:
            stem = re.sub(r'[^\w.-]+', '_', f'{start}-{what}')
            paths = [folder / f'{stem}.{kind}' for kind in KINDS]
            save(figure, *paths, dpi=150, bbox_inches='tight')


def _figure(x_label: str, *y_labels: str, height_in: float = _HEIGHT_IN) -> Any:
    """Return a figure with axes one below the other, for each label of y."""
    figure = new_figure(_WIDTH_IN, height_in)
    figure.set_layout_engine('constrained')
    for number, y_label in enumerate(y_labels, 1):
        axes = figure.add_subplot(len(y_labels), 1, number, facecolor='none')
        axes.set_ylabel(y_label, color=INK)
        axes.spines[:].set_visible(False)
        axes.tick_params(length=0, labelsize=8, labelcolor=INK)
        axes.grid(color=INK, alpha=0.15, linewidth=0.8)
        axes.set_axisbelow(True)
    axes.set_xlabel(x_label, color=INK)
    return figure


def _legend(figure: Any) -> Any:
    """Write what the labels mean below the axes, where there is room for any number."""
    handles, labels = figure.axes[0].get_legend_handles_labels()
    width, height = figure.get_size_inches()
    figure.set_size_inches(width, height + _LEGEND_IN * -(-len(labels) // 2))
    look = {'ncols': 2, 'fontsize': 7, 'labelcolor': INK, 'frameon': False}
    figure.legend(handles, labels, loc='outside lower center', **look)
    return figure


def _lines(
    runs: Sequence[Shown], lines: Sequence[Any], x_label: str, y_label: str, **look: Any
) -> Any:
    figure = _figure(x_label, y_label)
    (axes,) = figure.axes
    axes.set(xlim=(0, 1.01), ylim=(0, 1.01))
    names = sorted(one.name for one in runs)
    for name, x, y in lines:
        place = names.index(name)
        style = ('-', '--', ':', '-.')[place // 10 % 4]
        axes.plot(x, y, label=name, color=f'C{place}', linestyle=style, linewidth=1.6, **look)
    return _legend(figure)


def _matrix(one: Shown, scores: npt.NDArray[np.float32]) -> Any:
    shape = scores.shape[0] / scores.shape[1]
    figure = _figure('reference', 'query', height_in=min(max(4.5 * shape, 1.6), 6.0))
    (axes,) = figure.axes
    axes.grid(visible=False)
    show_scores(axes, scores)
    if one.truth is not None:
        show_truth(axes, one.truth)
    matched = [(row.query, row.best, row.verdict) for row in one.rows if row.best is not None]
    if matched:
        queries, references, verdicts = zip(*matched, strict=True)
        points = np.stack((queries, references), 1)
        show_matches(axes, points, np.array(verdicts), size=3.5)
    return _legend(figure)


def _lengths(one: Shown) -> Any:
    figure = _figure('query', 'k', 'entropy')
    upper, lower = figure.axes
    queries = [row.query for row in one.rows]
    upper.step(queries, [row.length for row in one.rows], where='post', color='C0')
    entropy = [np.nan if row.entropy is None else row.entropy for row in one.rows]
    lower.plot(queries, entropy, color='C1', linewidth=1)
    threshold = (one.run.summary.get('configuration') or {}).get('entropy_threshold')
    if threshold is not None:
        lower.axhline(threshold, color=INK, linestyle='--', linewidth=1)
    return figure
