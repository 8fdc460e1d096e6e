# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Any method's pair scores through the core's sequence stage, one query after the other.

The online recogniser does the same frame by frame; this serves what it does not: a forward window,
score matrices of other methods, parts of a map, and a drive against its own past.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial

from convseq_ros.config import Config, SequenceConfig
from convseq_ros.core.decision.acceptance import decide
from convseq_ros.core.decision.candidates import best_candidates
from convseq_ros.core.map.reference_map import Place
from convseq_ros.core.sequence.diagonals import BACKWARD, choose_length, Row, sequence_scores
from convseq_ros.core.types import Match, Reason, Status
from convseq_ros.evaluation.cache import Cache
from convseq_ros.evaluation.drive import Drive
import numpy as np
import numpy.typing as npt

SequenceScorer = Callable[[Sequence[Row | None]], npt.NDArray[np.float64]]


def choose_lengths(
    drive: Drive, config: SequenceConfig, direction: int, cache: Cache
) -> list[int]:
    """Return k for every frame as anchor; 0 where it shows nothing or more frames are needed."""
    if config.fixed_length == 1:
        return drive.informative.astype(int).tolist()
    facts = [drive.images.content, asdict(drive.encoding), asdict(config), direction]
    kept = cache.get('lengths', facts)
    if kept is None:
        kept = {'lengths': np.array(_chosen_lengths(drive, config, direction), np.int64)}
        cache.put('lengths', facts, kept)
    return kept['lengths'].tolist()


def _chosen_lengths(drive: Drive, config: SequenceConfig, direction: int) -> list[int]:
    described = drive.descriptors
    lengths = []
    for index, one in enumerate(described):
        outward = described[index::direction][: config.window]
        chosen = choose_length(outward, drive.similarity, config) if one.informative else None
        lengths.append(chosen or 0)
    return lengths


def score_sequences(
    rows: npt.NDArray[np.float32],
    drive: Drive,
    lengths: Sequence[int],
    direction: int = BACKWARD,
    scorer: SequenceScorer | None = None,
    partial_windows: bool = False,
) -> npt.NDArray[np.float64]:
    """
    Return the sequence scores of every frame.

    Parameters
    ----------
    rows : ndarray of float32, shape (Q, R)
        Pair scores, NaN where there is none.
    drive : Drive
        The query; the rows of uninformative frames are passed over.
    lengths : sequence of Q ints
        k; 0 for none.
    direction : BACKWARD or FORWARD
        Whether the k frames lie before or after the anchor.
    scorer : callable, optional
        Another way of scoring, such as SeqSLAM's trajectories.
    partial_windows : bool
        Whether a window may leave the map, as the recogniser's may with coherent matching.

    Returns
    -------
    ndarray of float64, shape (Q, R)
        -inf where there is none.

    """
    scorer = scorer or partial(sequence_scores, direction=direction, partial=partial_windows)
    seen = drive.informative & np.isfinite(rows).any(axis=1)
    usable = [row if there else None for row, there in zip(rows, seen, strict=True)]
    scores = np.full(rows.shape, -np.inf)
    for index, length in enumerate(lengths):
        if length and seen[index]:
            scores[index] = scorer(usable[index::direction][:length])
    return scores


def decide_frames(
    scores: npt.NDArray[np.float64],
    drive: Drive,
    places: Sequence[Place],
    lengths: Sequence[int],
    config: Config,
) -> list[Match]:
    """
    Return the answer to every frame, given its sequence scores (Q, R).

    The reasons are those of the recogniser.
    """
    return [
        _decided(index, scores[index], drive, places, length, config)
        for index, length in enumerate(lengths)
    ]


def _decided(
    index: int,
    scores: npt.NDArray[np.float64],
    drive: Drive,
    places: Sequence[Place],
    length: int,
    config: Config,
) -> Match:
    answer = partial(Match, index, drive.stamps_ns[index])
    skipped = partial(answer, Status.SKIPPED)
    if not drive.readable[index]:
        return skipped(Reason.UNREADABLE)
    if not drive.informative[index]:
        return skipped(Reason.UNINFORMATIVE)
    if not length:
        return skipped(Reason.WARMING_UP)
    candidates = best_candidates(np.arange(len(scores)), scores, places, config.acceptance)
    if not candidates:
        return skipped(Reason.MAP_TOO_SHORT, (), length)
    reason = decide(candidates, config.acceptance)
    status = Status.ACCEPTED if reason is Reason.ACCEPTED else Status.REJECTED
    return answer(status, reason, candidates, length)
