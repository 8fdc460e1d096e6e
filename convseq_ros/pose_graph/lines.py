# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A pose graph as the lines of files that others read: g2o's, and trajectories as TUM's."""

from collections.abc import Iterable, Iterator, Mapping
from operator import itemgetter
from pathlib import Path

from convseq_ros.core.rigid import Matrix, pose_of
from convseq_ros.core.types import Pose
from convseq_ros.io.regular_file import write_lines
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


def write_g2o(
    path: Path, poses: Poses, edges: Iterable[Edge], stamps_ns: Mapping[int, int]
) -> None:
    """Write a graph, and beside it, in `<path>.csv`, the times of its vertices."""
    write_lines(path, g2o(poses, edges))
    write_lines(beside(path), vertices({index: stamps_ns[index] for index in poses}))


def beside(path: Path) -> Path:
    """Return the table that belongs to a g2o file."""
    return path.with_name(f'{path.name}.csv')


def vertices(stamps_ns: Mapping[int, int]) -> Iterator[str]:
    """Yield the lines of a table of the times of vertices, by index."""
    yield 'vertex,stamp_ns'
    yield from (f'{index},{stamp_ns}' for index, stamp_ns in stamps_ns.items())


def tum(stamped: Iterable[tuple[int, Pose]]) -> Iterator[str]:
    """Yield stamped poses by time: seconds, position in metres, quaternion x y z w."""
    for stamp_ns, pose in sorted(stamped, key=itemgetter(0)):
        seconds, rest = divmod(stamp_ns, 10**9)
        numbers = ' '.join(f'{value:.9g}' for value in (*pose.position, *pose.orientation))
        yield f'{seconds}.{rest:09d} {numbers}'


def _numbers(moved: Matrix) -> str:
    pose = pose_of(moved)
    return ' '.join(f'{value:.9g}' for value in (*pose.position, *pose.orientation))
