# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A pose graph as the lines of a g2o file."""

from collections.abc import Iterable, Iterator

from convseq_ros.core.rigid import Matrix, pose_of
from convseq_ros.pose_graph.edges import Edge, Poses
import numpy as np


def g2o(poses: Poses, edges: Iterable[Edge]) -> Iterator[str]:
    """Yield the lines of a g2o file: a vertex for each place, by index, then the edges."""
    for index, pose in poses.items():
        yield f'VERTEX_SE3:QUAT {index} {_numbers(pose)}'
    for edge in edges:
        information = np.linalg.inv(edge.covariance)
        upper = ' '.join(f'{value:.9g}' for value in information[np.triu_indices(6)])
        yield f'EDGE_SE3:QUAT {edge.start} {edge.end} {_numbers(edge.moved)} {upper}'


def _numbers(moved: Matrix) -> str:
    pose = pose_of(moved)
    return ' '.join(f'{value:.9g}' for value in (*pose.position, *pose.orientation))
