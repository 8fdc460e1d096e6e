# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Precision-recall curves and accuracy bars of one data set."""

from collections.abc import Mapping, Sequence
import csv
from html import escape
from pathlib import Path

from convseq_ros.errors import ConvseqError
from convseq_ros.evaluation.report import charts
from convseq_ros.evaluation.report.charts import line, Plane, text, thinned
from convseq_ros.evaluation.report.summary_table import number
from convseq_ros.evaluation.run_folder import Run

BAR_PITCH = 26


def read_curve(folder: Path) -> tuple[list[float], list[float]]:
    """
    Return recall and precision of a run, both falling in threshold; empty if it has no curve.

    Raises
    ------
    ConvseqError
        If the file does not hold numbers under these two names.

    """
    path = folder / 'curve.csv'
    if not path.exists():
        return [], []
    try:
        with path.open(newline='', encoding='utf-8') as file:
            rows = [
                (float(row['recall']), float(row['precision'])) for row in csv.DictReader(file)
            ]
    except (KeyError, TypeError, ValueError, csv.Error):
        raise ConvseqError(
            f'{path}: not a precision-recall curve; run `convseq evaluate` again'
        ) from None
    return [row[0] for row in rows], [row[1] for row in rows]


def curves_chart(runs: Sequence[Run], colors: Mapping[str, int]) -> str:
    """Return the precision-recall curves of all methods on one set."""
    plane = Plane(48, 28, 480, 340, (0, 1), (0, 1))
    body = charts.axes(plane, 'recall', 'precision')
    for run in reversed(runs):
        recall, precision = read_curve(run.folder)
        if recall:
            points = plane.points(thinned([0.0, *recall]), thinned([precision[0], *precision]))
            auc = number(run.summary.get('auc_pr'))
            told = run.method if auc is None else f'{run.method}: AUC-PR {auc:.3f}'
            style = charts.method_style(colors[run.method])
            body.append(
                f'<polyline points="{points}" class="series {style}"'
                f' data-series="{escape(run.method)}"><title>{escape(told)}</title></polyline>'
            )
    label = f'Precision against recall on {runs[0].set}; one curve for each of {len(runs)} methods'
    return charts.svg(545, 412, label, body)


def accuracy_chart(runs: Sequence[Run], colors: Mapping[str, int]) -> str:
    """Return bars of accuracy over matched queries, with intervals; a tick is over all queries."""
    plane = Plane(190, 26, 285, BAR_PITCH * len(runs), (0, 1), (len(runs), 0))
    body = [line(plane, (tick, 0), (tick, len(runs)), 'grid') for tick in (0, 0.25, 0.5, 0.75, 1)]
    body += [text(plane.at(tick, 0)[0], 18, f'{tick:g}', 'tick', 'middle') for tick in (0, 0.5, 1)]
    for index, run in enumerate(runs):
        body.append(_bar(plane, index, run, colors[run.method]))
    told = ', '.join(f'{run.method} {accuracy(run):.3f}' for run in runs)
    label = f'Accuracy on {runs[0].set}: {told}'
    return charts.svg(545, plane.top + plane.height + 12, label, body)


def _bar(plane: Plane, index: int, run: Run, color: int) -> str:
    x, y = plane.at(0, index)
    end, _ = plane.at(accuracy(run), index)
    middle = y + BAR_PITCH / 2
    low, high, everything = (
        number(run.summary.get(key))
        for key in ('accuracy_matched_low', 'accuracy_matched_high', 'accuracy_all')
    )
    parts = [
        text(x - 9, middle + 4, _short(run.method), 'name', 'end'),
        f'<rect x="{x:.1f}" y="{y + 5:.1f}" width="{max(end - x, 1):.1f}"'
        f' height="{BAR_PITCH - 10}" rx="2" class="bar {charts.method_style(color)}"/>',
    ]
    if low is not None and high is not None:
        parts.append(line(plane, (low, index + 0.5), (high, index + 0.5), 'whisker'))
        parts += [
            line(plane, (edge, index + 0.34), (edge, index + 0.66), 'whisker')
            for edge in (low, high)
        ]
    if everything is not None:
        parts.append(line(plane, (everything, index + 0.12), (everything, index + 0.88), 'all'))
    known = number(run.summary.get('accuracy_matched'))
    shown = '-' if known is None else f'{known:.3f}'
    parts.append(text(plane.left + plane.width + 12, middle + 4, shown, 'value'))
    title = f'<title>{escape(f"{run.method}: {shown}")}</title>'
    return f'<g data-series="{escape(run.method)}">{title}{"".join(parts)}</g>'


def accuracy(run: Run) -> float:
    """Return the accuracy over matched queries, 0 if nothing was matched."""
    return number(run.summary.get('accuracy_matched')) or 0.0


def _short(name: str, most: int = 27) -> str:
    return name if len(name) <= most else name[: most - 1] + '…'
