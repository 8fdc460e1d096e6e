# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What became of each query of a run, read from its table of frames."""

from collections.abc import Mapping
from dataclasses import dataclass
import math

from convseq_ros.errors import ConvseqError
from convseq_ros.evaluation.run_folder import Run
import numpy as np
import numpy.typing as npt

VERDICTS = ('right', 'wrong', 'rejected', 'skipped')


@dataclass(frozen=True, slots=True)
class Seen:
    """
    One row of the table of frames.

    Parameters
    ----------
    query : int
        Index of the frame.
    verdict : str
        'right' and 'wrong' for an accepted match, 'rejected' for one that was not, 'skipped' where
        there was no candidate.
    best, truth : int, optional
        The best candidate, and the right reference that is nearest to it.
    correct, known, slip : bool
        Whether the best candidate is right; whether any reference is; whether it just missed.
    length : int
        Frames matched together.
    score, margin, entropy : float, optional
        Of the best candidate, before its rivals, of the image.
    reason, half : str
        Why it was decided so; which half of the map was kept (open protocol).
    inliers : int, optional
        Regions that moved alike from query to best candidate.

    """

    query: int
    verdict: str
    best: int | None
    truth: int | None
    correct: bool
    known: bool
    slip: bool
    length: int
    score: float | None
    margin: float | None
    entropy: float | None
    reason: str
    half: str
    inliers: int | None = None


def seen(run: Run, truth: npt.NDArray[np.bool_] | None) -> list[Seen]:
    """
    Return what became of each frame of a run.

    Raises
    ------
    ConvseqError
        If the table lacks a column or a number.

    """
    rows = []
    for position, row in enumerate(run.frames):
        try:
            rows.append(_seen(row, truth))
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise ConvseqError(
                f'{run.folder / "frames.csv"}: row {position + 1} is damaged'
                f' ({" ".join(str(error).split())}); run `convseq evaluate` again'
            ) from None
    return rows


def _seen(row: Mapping[str, str], truth: npt.NDArray[np.bool_] | None) -> Seen:
    query = int(row['query_index'])
    best = int(row['best_index']) if row['best_index'] else None
    correct = row['correct'] == '1'
    if best is None:
        verdict = 'skipped'
    elif row['status'] != 'accepted':
        verdict = 'rejected'
    else:
        verdict = 'right' if correct else 'wrong'
    return Seen(
        query,
        verdict,
        best,
        None if truth is None else nearest_right(truth[query], best),
        correct,
        row['known'] == '1',
        row.get('slip') == '1',
        int(row['sequence_length'] or 0),
        number(row['best_score']),
        number(row.get('margin')),
        number(row.get('entropy')),
        row['reason'],
        row.get('half') or '',
        int(row['inliers']) if row.get('inliers') else None,
    )


def nearest_right(right: npt.NDArray[np.bool_], best: int | None) -> int | None:
    """
    Return the reference to show as the truth of a query: the middle of a run of right ones.

    Parameters
    ----------
    right : ndarray of bool, shape (R,)
        Which references are right.
    best : int, optional
        The best candidate: the run nearest to it is taken, otherwise the longest.

    """
    spans = right_spans(right)
    if not spans:
        return None
    if best is None:
        start, end = max(spans, key=lambda span: span[1] - span[0])
    else:
        start, end = min(spans, key=lambda span: max(span[0] - best, best - span[1], 0))
    return (start + end) // 2


def right_spans(right: npt.NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and last of each run of right references; `right` is bool, shape (R,)."""
    edges = np.flatnonzero(np.diff(right.astype(np.int8), prepend=0, append=0))
    return list(zip(edges[::2].tolist(), (edges[1::2] - 1).tolist(), strict=True))


def number(text: str | None) -> float | None:
    """Return the number in a field; None if it is empty or not finite."""
    value = float(text) if text else math.nan
    return value if math.isfinite(value) else None
