# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The table of all sets and methods."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
import math
from typing import Any
from urllib.parse import quote

from convseq_ros.evaluation.run_folder import Run


@dataclass(frozen=True, slots=True)
class Column:
    """A number of the summary: its key, heading, meaning and digits; whether the most is best."""

    key: str
    heading: str
    meaning: str
    digits: int
    most_is_best: bool = False


COLUMNS = (
    Column('accuracy_matched', 'Accuracy', 'right / matched queries with an answer', 3, True),
    Column('accuracy_all', 'of all', 'right / all queries with an answer', 3, True),
    Column('auc_pr', 'AUC-PR', 'area under the curve, recall over right matches', 3, True),
    Column('recall_at_100_precision', 'R@100P',
           'share of matched queries with an answer found before the first mistake', 3, True),
    Column('recall_at_5', 'R@5', 'a right reference among the best five', 3, True),
    Column('accepted', 'Accepted', 'matches that the method itself stands by', 0),
    Column('accepted_recall_in_reach', 'Recall',
           'accepted and right / queries whose whole sequence lies in the map', 3),
    Column('false_closures', 'False', 'accepted and wrong by more than a slip', 0),
    Column('slips', 'Slips', 'accepted, 1 to 3 frames beyond the tolerance', 0),
    Column('pairs_per_frame', 'Pairs', 'image pairs compared for one query', 0),
    Column('mean_k', 'Mean k', 'frames matched together, on average', 1),
    Column('encode_ms', 'Encode', 'milliseconds to describe one image', 2),
    Column('frame_ms', 'Frame', 'milliseconds for one query in all', 2),
    Column('pcu', 'PCU', 'precision at full recall, weighed with the encoding time', 3, True),
    Column('queries', 'Queries', 'frames of the query sequence', 0),
    Column('known', 'Known', 'queries that have an answer', 0),
    Column('matched_known', 'Matched', 'queries that have an answer and got a candidate', 0),
)  # fmt: skip


def number(value: object) -> float | None:
    """Return a finite number, or None for whatever else a summary holds."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return float(value)


def summary_table(runs: Sequence[Run]) -> str:
    """Return the table; columns that no run fills are left out."""
    columns = [
        one for one in COLUMNS if any(number(run.summary.get(one.key)) is not None for run in runs)
    ]
    best = {
        (name, column.key): _best(column, [run for run in runs if run.set == name])
        for name in {run.set for run in runs}
        for column in columns
    }
    rows = ''.join(_row(run, columns, best) for run in runs)
    return (
        '<div class="scroll" tabindex="0" role="region" aria-label="Summary table">'
        f'<table class="sortable"><thead><tr>{_headings(columns)}</tr></thead>'
        f'<tbody>{rows}</tbody></table></div>'
    )


def _headings(columns: Iterable[Column]) -> str:
    names = [('Set', 'data set and protocol'), ('Method', 'what was measured')]
    texts = [_heading(name, meaning, '') for name, meaning in names]
    numbers = [_heading(column.heading, column.meaning, 'number') for column in columns]
    return ''.join(texts + numbers)


def _heading(name: str, meaning: str, style: str) -> str:
    return (
        f'<th scope="col" class="{style}" aria-sort="none">'
        f'<button type="button" title="{escape(meaning)}">{escape(name)}</button></th>'
    )


def _best(column: Column, runs: Iterable[Run]) -> float | None:
    values = [number(run.summary.get(column.key)) for run in runs]
    known = [value for value in values if value is not None]
    if not column.most_is_best or len(set(known)) < 2:
        return None
    return max(known)


def _row(run: Run, columns: Iterable[Column], best: dict[tuple[str, str], float | None]) -> str:
    protocol = str(run.summary.get('protocol', ''))
    cells = [_cell(run.summary, column, best[run.set, column.key]) for column in columns]
    link = f'#{quote(run.set)}/{quote(run.method)}'
    return (
        f'<tr><td>{escape(run.set)} <span class="badge">{escape(protocol)}</span></td>'
        f'<th scope="row"><a href="{escape(link)}">{escape(run.method)}</a></th>'
        f'{"".join(cells)}</tr>'
    )


def _cell(summary: Mapping[str, Any], column: Column, best: float | None) -> str:
    value = number(summary.get(column.key))
    if value is None:
        return '<td class="number" data-value="">&ndash;</td>'
    low, high = (number(summary.get(f'{column.key}_{end}')) for end in ('low', 'high'))
    span = ''
    if low is not None and high is not None:
        ends = f'{low:.{column.digits}f}&ndash;{high:.{column.digits}f}'
        span = f'<small title="95 % confidence interval">{ends}</small>'
    style = 'number best' if value == best else 'number'
    shown = f'{value:.{column.digits}f}'
    return f'<td class="{style}" data-value="{value!r}">{shown}{span}</td>'
