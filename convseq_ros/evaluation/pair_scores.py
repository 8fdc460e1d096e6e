# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a method gives: scores, costs, and its own way to go on from there, if it has one."""

from collections.abc import Callable
from dataclasses import dataclass

from convseq_ros.baselines.loop_detector import Detection
from convseq_ros.evaluation.given_scores import SequenceScorer
from convseq_ros.evaluation.recognition import Scores


@dataclass(frozen=True, slots=True)
class PairScores:
    """
    What a method gives: at least a row of scores for each of Q queries.

    All else is optional: what it costs, its own way to score a sequence, and its own decision.
    Without the latter every best candidate is accepted, and thresholds on the scores are tried.
    """

    scores: Scores  # (Q, R), higher is more similar; NaN where a pair was not scored
    encode_ms: float | None = None  # median time to describe an image, if known
    row_ms: float | None = None  # the same to score it against all references
    scorer: SequenceScorer | None = None  # of a sequence
    # The decision, of scores (Q, r) with the references from a number on: for each query the
    # likeliest reference, and how many keypoints confirm it, 0 if it is not accepted.
    detect: Callable[..., list[Detection]] | None = None
    place_bytes: float | None = None  # what a map keeps of a place, without pictures
