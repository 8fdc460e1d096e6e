# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The recogniser on the pair scores of any other method, and how a method ranks references."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

from convseq_ros.baselines.loop_detector import Detection
from convseq_ros.config import Config
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.matcher import Features, Matcher
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.sequence.query_buffer import sequence_scores
from convseq_ros.core.types import Descriptor, Indices, Match, Row, Shift
from convseq_ros.evaluation.material import Drive
from convseq_ros.evaluation.recognition import Scores, with_known
import numpy as np
import numpy.typing as npt

SequenceScores = npt.NDArray[np.float64]  # (Q, R); -inf where there is none
# Of the rows of the newest frame and of those before it, newest first, to scores (R,).
SequenceScorer = Callable[[Sequence[Row | None]], npt.NDArray[np.float64]]


@dataclass(frozen=True, slots=True)
class PairScores:
    """What a method gives: scores and perhaps its costs, its sequences and its own decision."""

    scores: Scores  # (Q, R), higher is more similar; NaN where a pair was not scored
    encode_ms: float | None = None  # median time to describe an image, if known
    row_ms: float | None = None  # the same to score it against all references
    scorer: SequenceScorer | None = None  # of a sequence
    # The decision, of scores (Q, r) with the references from a number on: for each query the
    # likeliest reference, and how many keypoints confirm it, 0 if it is not accepted.
    detect: Callable[..., list[Detection]] | None = None
    place_bytes: float | None = None  # what a map keeps of a place, without pictures


class GivenScores(Matcher):
    """Stands in for a matcher; `frame` is the row of the frame that comes next."""

    def __init__(self, rows: Scores) -> None:
        self.kernel, self.exact, self.frame = 'given', True, 0
        self._rows = rows

    def reset(self) -> None:
        """Forget nothing: rows are numbered."""

    def extract(self, _descriptor: Descriptor) -> Features | None:
        row = self._rows[self.frame]
        return Features(row, lambda: row) if np.isfinite(row).any() else None

    def scores_of(self, asked: Sequence[tuple[Features, Indices]]) -> list[Scores]:
        return [query.approximate[indices] for query, indices in asked]

    def shift(self, _query: Features, _index: int) -> Shift | None:
        """Return None: it is not given."""
        return None


def answers_to(
    rows: Scores,
    drive: Drive,
    reference_map: ReferenceMap,
    config: Config,
    scorer: SequenceScorer | None = None,
) -> tuple[list[Match], SequenceScores]:
    """
    Return the recogniser's answers to a drive, given its pair scores, and its sequence scores.

    With a `scorer`, the method's own scores of sequences decide.
    """
    if scorer is None:
        matches = _recognized(rows, drive, reference_map, config)
        lengths = [match.sequence_length for match in matches]
        return matches, rank_references(rows, drive, lengths)
    length = config.sequence.fixed_length
    lengths = [length * (index >= length - 1) for index in range(len(drive))]
    scores = rank_references(rows, drive, lengths, scorer)
    single = with_known(config, {'fixed_length': 1})
    own = np.where(np.isfinite(scores), scores, np.nan).astype(np.float32)
    matches = [
        replace(match, sequence_length=length if match.candidates else 0)
        for match in _recognized(own, drive, reference_map, single)
    ]
    scores[[not match.candidates for match in matches]] = -np.inf
    return matches, scores


def rank_references(
    rows: Scores,
    drive: Drive,
    lengths: Sequence[int],
    scorer: SequenceScorer | None = None,
    partial_windows: bool = False,
) -> SequenceScores:
    """Return sequence scores of every frame with every reference; `lengths` are their k, or 0."""
    scorer = scorer or partial(sequence_scores, partial=partial_windows)
    shown = drive.informative & np.isfinite(rows).any(axis=1)
    usable = [row if there else None for row, there in zip(rows, shown, strict=True)]
    scores = np.full(rows.shape, -np.inf)
    for index, length in enumerate(lengths):
        if length and shown[index]:
            scores[index] = scorer(usable[index::-1][:length])
    return scores


def _recognized(
    rows: Scores, drive: Drive, reference_map: ReferenceMap, config: Config
) -> list[Match]:
    given = GivenScores(rows)
    recognizer = PlaceRecognizer(reference_map, config, given)
    matches = []
    for frame, descriptor in drive.described:
        matches.append(recognizer.process(frame, descriptor))
        given.frame += 1
    return matches
