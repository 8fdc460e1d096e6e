# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Brings the sessions of a map into one frame, by their links."""

from collections.abc import Iterable, Sequence

from convseq_ros.core.rigid import inverse, Matrix
from convseq_ros.core.types import constants
from convseq_ros.pose_graph.edges import Edge, Poses
import numpy as np


@constants
class SESSION_ALIGNMENT:
    """Limits of the vote; chosen by experience, not tuned."""

    near_m: float = 3.0  # distance within which two links agree on where a session lies
    tried: int = 60  # links that are tried to align a session


def align_sessions(
    poses: Poses, session: Sequence[int], edges: Iterable[Edge]
) -> dict[int, Matrix]:
    """Return the poses of linked sessions in the frame of the first; links vote on each motion."""
    links = [edge for edge in edges if edge.is_link]
    if not links:
        return {}
    moves = {min(session[end] for edge in links for end in (edge.start, edge.end)): np.eye(4)}
    while True:
        # By session that has no motion yet: (goal, pose) of its places with a link to one moved.
        pairs = dict[int, list[tuple[Matrix, Matrix]]]()
        for edge in links:
            forth = edge.start, edge.end, edge.moved
            for fixed, new, moved in (forth, (edge.end, edge.start, inverse(edge.moved))):
                if session[fixed] in moves and session[new] not in moves:
                    goal = moves[session[fixed]] @ poses[fixed] @ moved
                    pairs.setdefault(session[new], []).append((goal, poses[new]))
        if not pairs:
            break
        best = max(pairs, key=lambda number: len(pairs[number]))
        moves[best] = agreed(pairs[best])
    return {at: moves[session[at]] @ pose for at, pose in poses.items() if session[at] in moves}


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
