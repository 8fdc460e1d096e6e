# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The charts of a report by matplotlib, for the page and as files for papers and slides."""

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
INK = '#1b2733'  # of files; on the page it becomes the colour of the text
_WIDTH_IN, _HEIGHT_IN, _LEGEND_IN = 5.2, 3.6, 0.17


def set_charts(runs: Sequence[Shown]) -> Iterator[tuple[str, str, Any]]:
    """Yield name, caption and figure of each chart of one set."""
    lines = []
    for run in runs:
        if len(run.curve):
            recall, precision = np.vstack(((0.0, run.curve[0, 1]), run.curve)).T
            lines.append((run.name, recall, precision))
    if lines:
        caption = (
            'Precision and recall: one point for every distinct score. Recall is over matched '
            'queries that have an answer.'
        )
        yield 'curves', caption, _lines(runs, lines, 'recall', 'precision')
    tables = [(run.name, (run.run.summary.get('calibration') or {})) for run in runs]
    calibrated = [
        (name, *(np.array([row[key] for row in table['as_shipped']]) for key in ('said', 'right')))
        for name, table in tables
        if table.get('as_shipped')
    ]
    if calibrated:
        caption = 'Reliability: how often a confidence is right, slips included.'
        figure = _lines(runs, calibrated, 'confidence', 'share that is right', marker='o')
        figure.axes[0].plot((0, 1), (0, 1), color=INK, alpha=0.4, linewidth=1)
        yield 'reliability', caption, figure


def run_charts(run: Shown) -> Iterator[tuple[str, str, Any]]:
    """Yield name, caption and figure of each chart of one run."""
    if run.scores is not None and run.scores.size:
        caption = (
            f'{run.name}: scores of image pairs; brighter is more similar. Between the white '
            'lines: truth. Dots: best candidates.'
        )
        yield 'matrix', caption, _matrix(run, run.scores)
    lengths = {row.length for row in run.rows if row.length}
    if len(lengths) > 1 and not any(row.half for row in run.rows):
        caption = f'{run.name}: frames matched together (k), and the entropy of each image.'
        yield 'lengths', caption, _lengths(run)


def svg(figure: Any, label: str) -> str:
    """Return a figure as SVG for the page, with INK replaced by the colour of the page's text."""
    from matplotlib import rc_context

    take_texts_literally(figure)
    buffer = StringIO()
    no_metadata = dict.fromkeys(('Creator', 'Date', 'Format', 'Type'))
    with rc_context({'svg.fonttype': 'none', 'svg.hashsalt': label}):
        figure.savefig(buffer, format='svg', metadata=no_metadata, transparent=True)
    text = buffer.getvalue().replace(INK, 'currentColor')
    return f'<svg role="img" aria-label="{escape(label)}"' + text[text.index('<svg') + 4 :]


def write_figures(runs: Sequence[Shown], folder: Path) -> None:
    """Write the charts of every set and method as .png, .svg and .pdf."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in dict.fromkeys(run.run.set for run in runs):
        set_runs = [run for run in runs if run.run.set == name]
        charts = [(name, kind, figure) for kind, _, figure in set_charts(set_runs)]
        for run in set_runs:
            charts += [(f'{name}-{run.name}', kind, figure) for kind, _, figure in run_charts(run)]
        for start, kind, figure in charts:
            stem = re.sub(r'[^\w.-]+', '_', f'{start}-{kind}')
            paths = [folder / f'{stem}.{suffix}' for suffix in KINDS]
            save(figure, *paths, dpi=150, bbox_inches='tight')


def _figure(x_label: str, *y_labels: str, height_in: float = _HEIGHT_IN) -> Any:
    """Return a figure with one axes per y label, stacked vertically."""
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
    """Draw the legend below the axes and enlarge the figure for it."""
    handles, labels = figure.axes[0].get_legend_handles_labels()
    width, height = figure.get_size_inches()
    figure.set_size_inches(width, height + _LEGEND_IN * -(-len(labels) // 2))
    style = {'ncols': 2, 'fontsize': 7, 'labelcolor': INK, 'frameon': False}
    figure.legend(handles, labels, loc='outside lower center', **style)
    return figure


def _lines(
    runs: Sequence[Shown], lines: Sequence[Any], x_label: str, y_label: str, **how: Any
) -> Any:
    figure = _figure(x_label, y_label)
    (axes,) = figure.axes
    axes.set(xlim=(0, 1.01), ylim=(0, 1.01))
    names = sorted(run.name for run in runs)
    for name, x, y in lines:
        position = names.index(name)
        style = ('-', '--', ':', '-.')[position // 10 % 4]
        axes.plot(x, y, label=name, color=f'C{position}', linestyle=style, linewidth=1.6, **how)
    return _legend(figure)


def _matrix(run: Shown, scores: npt.NDArray[np.float32]) -> Any:
    shape = scores.shape[0] / scores.shape[1]
    figure = _figure('reference', 'query', height_in=min(max(4.5 * shape, 1.6), 6.0))
    (axes,) = figure.axes
    axes.grid(visible=False)
    show_scores(axes, scores)
    if run.truth is not None:
        show_truth(axes, run.truth)
    matched = [(row.query, row.best, row.verdict) for row in run.rows if row.best is not None]
    if matched:
        queries, references, verdicts = zip(*matched, strict=True)
        points = np.stack((queries, references), 1)
        show_matches(axes, points, np.array(verdicts), size=3.5)
    return _legend(figure)


def _lengths(run: Shown) -> Any:
    figure = _figure('query', 'k', 'entropy')
    upper, lower = figure.axes
    queries = [row.query for row in run.rows]
    upper.step(queries, [row.length for row in run.rows], where='post', color='C0')
    entropy = [np.nan if row.entropy is None else row.entropy for row in run.rows]
    lower.plot(queries, entropy, color='C1', linewidth=1)
    threshold = (run.run.summary.get('configuration') or {}).get('entropy_threshold')
    if threshold is not None:
        lower.axhline(threshold, color=INK, linestyle='--', linewidth=1)
    return figure
