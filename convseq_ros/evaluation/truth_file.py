# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Truth as people keep it: tables of pairs, and positions."""

from collections.abc import Callable, Mapping, Sequence
import csv
import io
from pathlib import Path

from convseq_ros.errors import SourceError
from convseq_ros.files import read_text
from convseq_ros.reading_config import ReadingConfig
import numpy as np
import numpy.typing as npt

Pairs = npt.NDArray[np.int64]


def read_pairs(
    path: Path,
    query_names: Sequence[str],
    reference_names: Sequence[str],
    first_index: int = 0,
    reading: ReadingConfig = ReadingConfig(),
) -> Pairs:
    """
    Return the pairs of a table, int64 (P, 2), or (P, 3) with the tolerance of each, from 0.

    It is a CSV table with a header. The first column is the query and the second the reference,
    each a frame number, counted from `first_index`, or a file name of those given in the order of
    the frames; several references stand in several rows, or in one cell with spaces between them.
    A column called `tolerance` holds for its row. SourceError if it cannot be read.
    """
    text = io.StringIO(read_text(path, 'a CSV table', reading), newline='')
    try:
        rows = [row for row in csv.reader(text) if any(cell.strip() for cell in row)]
    except csv.Error:
        raise SourceError(f'{path}: not a CSV table; check the file') from None
    header = [cell.strip().lower() for cell in rows[0]] if rows else []
    if len(header) < 2:
        raise SourceError(f'{path}: expected a header and the columns query, reference')
    own = header.index('tolerance') if 'tolerance' in header else None
    numbers = [_numbers(query_names, first_index), _numbers(reference_names, first_index)]
    pairs = []
    for line, row in enumerate(rows[1:], 2):
        try:
            query = numbers[0](row[0].strip())
            reach = [] if own is None else [int(row[own])]
            pairs += [[query, numbers[1](cell), *reach] for cell in row[1].split()]
        except (IndexError, ValueError, OverflowError):
            raise SourceError(
                f'{path}: line {line} ({",".join(row)[:80]}) names no frames; expected numbers or '
                'names of images'
            ) from None
    try:
        return np.array(pairs, np.int64).reshape(-1, 2 if own is None else 3)
    except OverflowError:
        raise SourceError(f'{path}: a number is no frame, it is too large') from None


def read_positions(
    path: Path, drive: str, count: int, reading: ReadingConfig = ReadingConfig()
) -> npt.NDArray[np.float64]:
    """
    Return where the frames of a drive, `query` or `reference`, were taken, (count, 3), metres.

    It is a CSV table with the columns x, y and perhaps z, one row for every frame, in order. If it
    has a column `drive`, only rows of this drive count. SourceError if it cannot be read, or its
    rows are not as many as the frames.
    """
    text = io.StringIO(read_text(path, 'a CSV table', reading), newline='')
    try:
        rows: list[Mapping[str, str]] = list(csv.DictReader(text))
        own = [row for row in rows if row.get('drive', drive) == drive]
        positions = [[float(row['x']), float(row['y']), float(row.get('z') or 0)] for row in own]
    except (csv.Error, KeyError, TypeError, ValueError):
        raise SourceError(
            f'{path}: expected a CSV table with the columns x, y, z in metres'
        ) from None
    if len(positions) != count:
        raise SourceError(
            f'{path}: {len(positions)} positions for {count} {drive} images; give one for each'
        )
    return np.array(positions).reshape(-1, 3)


def _numbers(names: Sequence[str], first_index: int) -> Callable[[str], int]:
    by_name = {name: index for index, name in enumerate(names)}
    by_name |= {Path(name).stem: index for index, name in enumerate(names)}

    def number(cell: str) -> int:
        try:
            return int(cell) - first_index
        except ValueError:
            return by_name[cell] if cell in by_name else int(float(cell)) - first_index

    return number
