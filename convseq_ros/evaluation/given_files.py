# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Files of scores and descriptors (.npy) that somebody computed with another program."""

from pathlib import Path

from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.errors import SourceError
from convseq_ros.io.files import read_array
import numpy as np
import numpy.typing as npt


def read_scores(
    path: Path, queries: int, references: int, reading: ReadingConfig = ReadingConfig()
) -> npt.NDArray[np.float32]:
    """Return the pair scores in a .npy file, (queries, references)."""
    scores = _numbers_in(path, reading)
    if scores.shape != (queries, references):
        shape = ' x '.join(map(str, scores.shape))
        advice = '; transpose it' if scores.shape == (references, queries) else ''
        raise SourceError(
            f'{path}: a matrix of {shape} scores for {queries} queries and {references} '
            f'references; expected query by reference{advice}'
        )
    return scores


def read_descriptors(
    path: Path, count: int, reading: ReadingConfig = ReadingConfig()
) -> npt.NDArray[np.float32]:
    """Return one descriptor per image, (N, D); SourceError for another count, or NaN."""
    rows = _numbers_in(path, reading)
    if rows.ndim < 2 or len(rows) != count:
        raise SourceError(
            f'{path}: an array of shape {rows.shape} for {count} images; expected one row for each'
        )
    return rows.reshape(count, -1)


def _numbers_in(path: Path, reading: ReadingConfig) -> npt.NDArray[np.float32]:
    try:
        numbers = read_array(path, reading)
        with np.errstate(over='ignore'):
            numbers = numbers.astype(np.float32, casting='same_kind')
    except (TypeError, ValueError):
        raise SourceError(f'{path}: not a .npy file of plain numbers; save one') from None
    if not np.isfinite(numbers).all():
        where = ', '.join(map(str, np.argwhere(~np.isfinite(numbers))[0]))
        raise SourceError(f'{path}: holds NaN or infinity, first at [{where}]; compute it again')
    return numbers
