# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The evidence of the buffer's frames for the likeliest place: how new they are, and k."""

from collections.abc import Sequence

from convseq_ros.core.sequence.query_buffer import BufferedFrame
from convseq_ros.core.types import constants
import numpy as np


@constants
class EVIDENCE:
    """Which frames of the buffer count."""

    carried: float = 0.9  # share of the evidence that the k newest frames carry; engineering


def novelty(frames: Sequence[BufferedFrame]) -> float:
    """
    Return how new the newest of frames is, in [0, 1]: 1 if its cosine with the last is at most .5.

    Frames are newest first. One after an empty slot, or without cells, is new.
    """
    images = [one.features.packed for one in frames[:2] if one.features and one.features.packed]
    vectors = [image.rows.view(np.int8).ravel().astype(np.float32) for image in images]
    if len(vectors) < 2 or not (
        lengths := float(np.linalg.norm(vectors[0]) * np.linalg.norm(vectors[1]))
    ):
        return 1.0
    return min(1.0, max(0.0, 2 - 2 * float(vectors[0] @ vectors[1]) / lengths))


def evidence_length(frames: Sequence[BufferedFrame]) -> int:
    """Return how many of the newest frames, k, carry nine tenths of the frames' evidence."""
    carried = np.cumsum([frame.evidence for frame in frames])
    return 1 + int(np.searchsorted(carried, EVIDENCE.carried * carried[-1]))
