# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How a method ranks all references for every frame: what recall among the best N is about."""

from collections.abc import Callable, Sequence
from functools import partial

from convseq_ros.core.sequence.diagonals import sequence_scores
from convseq_ros.core.types import Row
from convseq_ros.evaluation.drive import Drive
import numpy as np
import numpy.typing as npt

SequenceScorer = Callable[[Sequence[Row | None]], npt.NDArray[np.float64]]


def rank_references(
    rows: npt.NDArray[np.float32],
    drive: Drive,
    lengths: Sequence[int],
    forward: bool = False,
    scorer: SequenceScorer | None = None,
    partial_windows: bool = False,
) -> npt.NDArray[np.float64]:
    """
    Return the sequence scores of every frame with every reference.

    Parameters
    ----------
    rows : ndarray of float32, shape (Q, R)
        Pair scores, NaN where there is none.
    drive : Drive
        The query; the rows of uninformative frames are passed over.
    lengths : sequence of Q ints
        k; 0 for none.
    forward : bool
        Whether the k frames lie after the anchor, not before it.
    scorer : callable, optional
        Another way of scoring, such as SeqSLAM's trajectories.
    partial_windows : bool
        Whether a window may leave the map, as those of the belief may.

    Returns
    -------
    ndarray of float64, shape (Q, R)
        -inf where there is none.

    """
    if forward:
        flipped = rank_references(rows[::-1, ::-1], drive.flipped, lengths[::-1], False, scorer)
        return flipped[::-1, ::-1]
    scorer = scorer or partial(sequence_scores, partial=partial_windows)
    shown = drive.informative & np.isfinite(rows).any(axis=1)
    usable = [row if there else None for row, there in zip(rows, shown, strict=True)]
    scores = np.full(rows.shape, -np.inf)
    for index, length in enumerate(lengths):
        if length and shown[index]:
            scores[index] = scorer(usable[index::-1][:length])
    return scores
