# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What was measured, one row at a time, and the rows as text."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

COLUMNS = 'what', 'side', 'threads', 'measured', 'target', 'met', 'notes'
Row = Mapping[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """What was measured of one side."""

    what: str  # was done
    side: str = ''  # which part of it, or by whom
    value: float | None = None  # the median; None if not measured, and `note` says why
    unit: str = 'ms'  # of the numbers
    threads: int = 1  # that it was allowed; so many cores, too
    low: float | None = None  # quartiles over the runs
    high: float | None = None
    runs: int = 1
    most: float | None = None  # what is wanted of `value`
    least: float | None = None
    note: str = ''


def is_met(row: Row) -> bool | None:
    """Return whether a target was reached; None if there is none, or nothing was measured."""
    value, most, least = row['value'], row['most'], row['least']
    if value is None or (most is None and least is None):
        return None
    return (most is None or value <= most) and (least is None or value >= least)


def cells(row: Row) -> list[str]:
    """Return a finding as text, column by column."""
    value, unit = row['value'], row['unit']
    wanted = [('at most', row['most']), ('at least', row['least'])]
    return [
        row['what'],
        row['side'],
        str(row['threads']),
        'not measured' if value is None else f'{number(value)} {unit}',
        ', '.join(f'{how} {number(one)} {unit}' for how, one in wanted if one is not None),
        {None: '', True: 'met', False: 'missed'}[is_met(row)],
        row['note'],
    ]


def table(lines: Iterable[list[str]]) -> str:
    """Return a table in Markdown; the first line is its head."""
    head, *rows = lines
    marked = (f'| {" | ".join(line)} |\n' for line in [head, ['---'] * len(head), *rows])
    return ''.join(marked)


def number(value: float) -> str:
    """Return a number with three digits that count."""
    return f'{value:,.0f}' if abs(value) >= 100 else f'{value:.3g}'
