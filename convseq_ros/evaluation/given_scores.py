# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Runs the recogniser on another method's pair scores, and ranks references by sequence."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from convseq_ros.baselines.loop_detector import Detection
from convseq_ros.config import Config
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.sequence.query_buffer import sequence_scores
from convseq_ros.core.similarity.scorer import Features, Scorer
from convseq_ros.core.types import Descriptor, Indices, Match, Row
from convseq_ros.evaluation.drive import DescribedDrive
from convseq_ros.evaluation.query_answers import overridden, Scores
import numpy as np
import numpy.typing as npt

SequenceScores = npt.NDArray[np.float64]  # (Q, R); -inf where there is no score
# From the score rows of consecutive frames, newest first, to sequence scores (R,).
SequenceScorer = Callable[[Sequence[Row | None]], npt.NDArray[np.float64]]


@dataclass(frozen=True, slots=True)
class PairScores:
    """A method's scores, and optionally its costs, sequence scorer and decision."""

    scores: Scores  # (Q, R), higher is more similar; NaN where a pair was not scored
    encode_ms: float | None = None  # median time to describe an image, if measured
    row_ms: float | None = None  # median time to score it against all references
    scorer: SequenceScorer | None = None  # replaces the recogniser's sequence scores
    # The decision. It takes scores (Q, r) and the index of their first reference. It returns for
    # each query the best reference and its inliers, 0 if it is not accepted.
    detect: Callable[..., list[Detection]] | None = None
    place_bytes: float | None = None  # size of a place in a map, without pictures


class GivenScores(Scorer):
    """A scorer that returns given scores, those of the first frame until `advance`."""

    def __init__(self, rows: Scores) -> None:
        self.kernel, self._frame = 'given', 0
        self._rows = rows

    def advance(self) -> None:
        """Go on to the scores of the next frame."""
        self._frame += 1

    def extract(self, _descriptor: Descriptor) -> Features | None:
        row = self._rows[self._frame]
        return Features(row) if np.isfinite(row).any() else None

    def scores_of(self, requests: Sequence[tuple[Features, Indices]]) -> list[Scores]:
        return [query.scored[indices] for query, indices in requests]


def recognize_given(
    rows: Scores,
    drive: DescribedDrive,
    reference_map: ReferenceMap,
    config: Config,
    scorer: SequenceScorer | None = None,
) -> tuple[list[Match], SequenceScores]:
    """
    Return the recogniser's matches for a drive with given pair scores, and the sequence scores.

    With a `scorer`, the decision uses the method's sequence scores.
    """
    if scorer is None:
        matches = _recognized(rows, drive, reference_map, config)
        lengths = [match.sequence_length for match in matches]
        return matches, rank_references(rows, drive, lengths)
    length = config.sequence.fixed_length
    lengths = [length * (index >= length - 1) for index in range(len(drive))]
    scores = rank_references(rows, drive, lengths, scorer)
    single = overridden(config, {'fixed_length': 1})
    sequence_rows = np.where(np.isfinite(scores), scores, np.nan).astype(np.float32)
    matches = [
        replace(match, sequence_length=length if match.candidates else 0)
        for match in _recognized(sequence_rows, drive, reference_map, single)
    ]
    scores[[not match.candidates for match in matches]] = -np.inf
    return matches, scores


def rank_references(
    rows: Scores,
    drive: DescribedDrive,
    lengths: Sequence[int],
    scorer: SequenceScorer = sequence_scores,
) -> SequenceScores:
    """Return sequence scores (Q, R); `lengths` (Q,) are the sequence lengths k, 0 for none."""
    usable = drive.informative & np.isfinite(rows).any(axis=1)
    usable_rows = [row if flag else None for row, flag in zip(rows, usable, strict=True)]
    scores = np.full(rows.shape, -np.inf)
    for index, length in enumerate(lengths):
        if length and usable[index]:
            scores[index] = scorer(usable_rows[index::-1][:length])
    return scores


def _recognized(
    rows: Scores, drive: DescribedDrive, reference_map: ReferenceMap, config: Config
) -> list[Match]:
    matcher = GivenScores(rows)
    recognizer = PlaceRecognizer(reference_map, config, matcher)
    matches = []
    for frame, descriptor in drive.described:
        matches.append(recognizer.process(frame, descriptor))
        matcher.advance()
    return matches
