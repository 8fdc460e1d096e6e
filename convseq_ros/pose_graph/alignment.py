# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Brings a drive into the frame of others, by its links with them."""

from collections.abc import Sequence

from convseq_ros.core.rigid import inverse, Matrix
from convseq_ros.core.types import constants
import numpy as np


@constants
class SESSION_ALIGNMENT:
    """Limits of the vote; chosen by experience, not tuned."""

    near_m: float = 3.0  # distance within which two links agree on where a session lies
    tried: int = 60  # links that are tried to align a session


def agreed(pairs: Sequence[tuple[Matrix, Matrix]]) -> Matrix:
    """
    Return the motion that brings most poses to their goals; none, if that is as good.

    `pairs` are (goal, pose).
    """
    goals = np.array([goal[:3, 3] for goal, _ in pairs])
    positions = np.array([pose[:3, 3] for _, pose in pairs])
    tried = pairs[:: max(1, len(pairs) // SESSION_ALIGNMENT.tried)]
    moves = [np.eye(4), *(goal @ inverse(pose) for goal, pose in tried)]
    counts = []
    for move in moves:
        errors_m = np.linalg.norm(positions @ move[:3, :3].T + move[:3, 3] - goals, axis=1)
        counts.append(int((errors_m <= SESSION_ALIGNMENT.near_m).sum()))
    return moves[int(np.argmax(counts))]
