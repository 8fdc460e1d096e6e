# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Measurements, one per row, and the rows as text."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

COLUMNS = 'what', 'side', 'threads', 'measured', 'target', 'met', 'notes'
Row = Mapping[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One measurement."""

    what: str  # the measured operation
    side: str = ''  # the part of it, or the program
    value: float | None = None  # the median; None if not measured, with the reason in `note`
    unit: str = 'ms'  # of the numbers
    threads: int = 1  # allowed threads, and number of cores
    low: float | None = None  # quartiles over the runs
    high: float | None = None
    runs: int = 1
    most: float | None = None  # target of `value`
    least: float | None = None
    note: str = ''


def is_met(row: Row) -> bool | None:
    """Return whether the target was reached; None without a target or a measurement."""
    value, most, least = row['value'], row['most'], row['least']
    if value is None or (most is None and least is None):
        return None
    return (most is None or value <= most) and (least is None or value >= least)


def cells(row: Row) -> list[str]:
    """Return the cells of a finding as text, in the order of COLUMNS."""
    value, unit = row['value'], row['unit']
    targets = [('at most', row['most']), ('at least', row['least'])]
    return [
        row['what'],
        row['side'],
        str(row['threads']),
        'not measured' if value is None else f'{number(value)} {unit}',
        ', '.join(f'{how} {number(limit)} {unit}' for how, limit in targets if limit is not None),
        {None: '', True: 'met', False: 'missed'}[is_met(row)],
        row['note'],
    ]


def table(lines: Iterable[list[str]]) -> str:
    """Return a table in Markdown; the first line is its head."""
    head, *rows = lines
    marked = (f'| {" | ".join(line)} |\n' for line in [head, ['---'] * len(head), *rows])
    return ''.join(marked)


def number(value: float) -> str:
    """Return a number as text with three significant digits."""
    return f'{value:,.0f}' if abs(value) >= 100 else f'{value:.3g}'
