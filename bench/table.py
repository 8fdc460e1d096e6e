# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Findings as rows of text."""

from collections.abc import Iterable, Mapping
from typing import Any

Row = Mapping[str, Any]
COLUMNS = 'what', 'side', 'threads', 'measured', 'times faster', 'target', 'met', 'notes'


def cells(row: Row) -> list[str]:
    """Return a finding as text, column by column."""
    value = row['value']
    return [
        row['what'],
        row['side'],
        str(row['threads']),
        'not measured' if value is None else _with_unit(value, row['unit']),
        f'{number(row["times"])} x {row["against"]}' if row['times'] else '',
        row['target'],
        {None: '', True: 'met', False: 'missed'}[row['met']],
        row['note'],
    ]


def table(rows: Iterable[Row]) -> str:
    """Return a table for a terminal."""
    lines = [list(COLUMNS), *map(cells, rows)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return '\n'.join(
        '  '.join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
        for line in lines
    )


def number(value: float) -> str:
    """Return a number with three digits that count."""
    if value >= 100:
        return f'{value:,.0f}'
    return f'{value:.3g}' if value >= 0.001 else f'{value:.1g}'


def in_units(cost_ms: float) -> str:
    """Return a time in milliseconds, or in seconds if it is long."""
    return f'{number(cost_ms / 1e3)} s' if cost_ms >= 1e3 else f'{number(cost_ms)} ms'


def _with_unit(value: float, unit: str) -> str:
    return in_units(value) if unit == 'ms' else f'{number(value)} {unit}'
