# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The table of all sets and methods, for the terminal and the report."""

from collections.abc import Mapping, Sequence
import math
from typing import Any

HEADINGS = {
    'set': 'set',
    'method': 'method',
    'accuracy_matched': 'acc. matched',
    'interval': '95 %',
    'matched_known': 'of',
    'accuracy_all': 'acc. all',
    'known': 'of all',
    'auc_pr': 'AUC-PR',
    'recall_at_100_precision': 'R at 100 % P',
    'precision_at_100_recall': 'P at 100 % R',
    'pcu': 'PCU',
    'accepted_recall': 'accepted R',
    'false_closures': 'false',
    'slips': 'slips',
    'first_closures': 'first after',
    'own_threshold_recall': 'R at 0 false',
    'mean_k': 'mean k',
    'encode_ms': 'encode ms',
    'frame_ms': 'frame ms',
    'place_bytes': 'bytes a place',
}
_HIGHER_IS_BETTER = (
    'accuracy_matched', 'accuracy_all', 'auc_pr', 'recall_at_100_precision',
    'precision_at_100_recall', 'pcu',
)  # fmt: skip


def summary_rows(summaries: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the main figures of every summary, in display order."""
    rows = []
    for summary in summaries:
        low, high = summary.get('accuracy_matched_low'), summary.get('accuracy_matched_high')
        interval = '' if low is None or high is None else f'{low:.2f}-{high:.2f}'
        figures = {**summary, 'interval': interval, 'first_closures': first_closures(summary)}
        rows.append({name: figures.get(name) for name in HEADINGS})
    return rows


def check_figures(summary: Mapping[str, Any]) -> None:
    """Raise an exception, of any type, if a figure of a foreign summary is not a number."""
    texts = 'set', 'method', 'interval', 'first_closures'
    names = [name for name in HEADINGS if name not in texts]
    names += ['accuracy_matched_low', 'accuracy_matched_high']
    values = [summary.get(name) for name in names]
    values += (summary.get('frames_to_first_closure') or {}).values()
    for value in values:
        if isinstance(value, str) or (value is not None and not math.isfinite(value)):
            raise ValueError(f'{value!r} is not a figure')


def first_closures(summary: Mapping[str, Any]) -> str:
    """Return the numbers of frames to the first right closure, per part of the map, as text."""
    frames = summary.get('frames_to_first_closure') or {}
    return ', '.join('-' if count is None else str(count) for count in frames.values())


def best_of(rows: Sequence[Mapping[str, Any]], name: str) -> float | None:
    """Return the highest value of a column, or None if rows are equal or lower is better."""
    values = {row[name] for row in rows} - {None} if name in _HIGHER_IS_BETTER else set()
    return max(values) if len(values) > 1 else None


def format_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the rows with aligned columns; the first row's keys are the columns."""
    if not rows:
        return ''
    names = list(rows[0])
    table = [[HEADINGS.get(name, name) for name in names]]
    table += [[text_of(row.get(name)) for name in names] for row in rows]
    widths = [max(len(line[column]) for line in table) for column in range(len(names))]
    numeric = [
        all(isinstance(row.get(name), int | float | None) for row in rows) for name in names
    ]
    return '\n'.join(
        '  '.join(
            cell.rjust(width) if is_number else cell.ljust(width)
            for cell, width, is_number in zip(line, widths, numeric, strict=True)
        ).rstrip()
        for line in table
    )


def text_of(value: Any) -> str:
    """Return a figure as text, - for None."""
    if value is None:
        return '-'
    if isinstance(value, float):
        return f'{value:.3f}' if abs(value) < 10 else f'{value:.1f}'
    return str(value)
