# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether two methods decide alike, frame by frame."""

from convseq_ros.errors import ConvseqError
from convseq_ros.evaluation.run_folder import Run

SAME_PLACE = 2


def agreement(one: Run, other: Run) -> float:
    """
    Return the share of frames on which two runs on one set decide the same.

    That is, neither accepts a match, or both accept one within 2 references.

    Raises
    ------
    ConvseqError
        If they are not runs on the same frames.

    """
    if len(one.frames) != len(other.frames) or not one.frames:
        raise ConvseqError(
            f'{one.folder} and {other.folder}: {len(one.frames)} and {len(other.frames)} frames '
            'cannot be compared; evaluate both on one set'
        )
    pairs = zip(one.frames, other.frames, strict=True)
    same = sum(
        _alike(first['reference_index'], second['reference_index']) for first, second in pairs
    )
    return same / len(one.frames)


def _alike(first: str, second: str) -> bool:
    if not first or not second:
        return first == second
    return abs(int(first) - int(second)) <= SAME_PLACE
