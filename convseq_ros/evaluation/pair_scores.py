# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a method gives: scores, times, and its own way to go on from there, if it has one."""

from collections.abc import Callable
from dataclasses import dataclass

from convseq_ros.baselines.loop_detector import Detection
from convseq_ros.evaluation.ranking import SequenceScorer
import numpy as np
import numpy.typing as npt


@dataclass(frozen=True, slots=True)
class PairScores:
    """
    What a method gives.

    Parameters
    ----------
    scores : ndarray of float32, shape (Q, R)
        Query by reference, higher is more similar; NaN where a pair was not scored.
    encode_ms, row_ms : float or None
        Median time to encode an image and to score it against all references, if known.
    scorer : callable or None
        The method's own way to score a sequence.
    detect : callable or None
        The method's own decision, of scores (Q, r) with the references from a number on.
    place_bytes : float or None
        What a map must keep of a place, if known.

    """

    scores: npt.NDArray[np.float32]
    encode_ms: float | None = None
    row_ms: float | None = None
    scorer: SequenceScorer | None = None
    detect: Callable[..., list[Detection]] | None = None
    place_bytes: float | None = None
