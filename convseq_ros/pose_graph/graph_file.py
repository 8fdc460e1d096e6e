# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A pose graph in a file beside its map, and trajectories in the format of TUM."""

from collections.abc import Iterable, Iterator
from itertools import accumulate, pairwise
import json
from pathlib import Path
from typing import Any
import zipfile

from convseq_ros.config.pose_graph_config import PoseGraphConfig
from convseq_ros.core.rigid import Matrix
from convseq_ros.core.types import Pose
from convseq_ros.errors import MapError, one_line
from convseq_ros.io.regular_file import complete_or_absent, refuse_irregular, write_lines
from convseq_ros.pose_graph.closures import Closure, Known
from convseq_ros.pose_graph.edges import Edge
from convseq_ros.pose_graph.graph import PoseGraph
from convseq_ros.pose_graph.odometry import Odometry
import numpy as np

_FORMAT = 1
_MOST_BYTES = 1 << 30
_SHAPES = {
    'stamps': (), 'poses': (3, 4), 'keyframes': (), 'spread': (2,), 'nodes': (), 'solved': (3, 4),
    'ends': (2,), 'moved': (3, 4), 'covariances': (6, 6), 'times': (2,), 'kept': (),
}  # fmt: skip


def save_graph(graph: PoseGraph, path: Path, map_id: str) -> int:
    """
    Write the drives that are sessions of a map, if any, in one step; return their number.

    A drive without a session, such as one in a preloaded map, is never referred to again.
    """
    drives = [drive for drive in graph.drives if drive.session and drive.keyframes]
    if not drives:
        return 0
    end = 1 + sum(len(drive.keyframes) for drive in drives)
    links = [one for one in graph.known.values() if one.edge and one.kept is not None]
    links = [one for one in links if one.edge and one.edge.end < end]
    edges = [one.edge for one in links if one.edge]
    poses = {node: pose for node, pose in graph.poses().items() if node < end}
    header = {
        'format': _FORMAT,
        'map_id': map_id,
        'sessions': [drive.session for drive in drives],
        'samples': [len(drive.stamps) for drive in drives],
        'keyframes': [len(drive.keyframes) for drive in drives],
        'references': [one.closure.session for one in links],
    }
    arrays: dict[str, Any] = {
        'stamps': [stamp for drive in drives for stamp in drive.stamps],
        'poses': [pose[:3] for drive in drives for pose in drive.poses],
        'keyframes': [at for drive in drives for at in drive.keyframes],
        'spread': [row for drive in drives for row in drive.variances()],
        'nodes': [*poses],
        'solved': [pose[:3] for pose in poses.values()],
        'ends': [(edge.start, edge.end) for edge in edges],
        'moved': [edge.moved[:3] for edge in edges],
        'covariances': [edge.covariance for edge in edges],
        'times': [(one.closure.query_ns, one.closure.reference_ns) for one in links],
        'kept': [bool(one.kept) for one in links],
    }
    shaped = {name: np.reshape(arrays[name], (-1, *_SHAPES[name])) for name in _SHAPES}
    text = np.frombuffer(json.dumps(header).encode(), np.uint8)
    with complete_or_absent(path) as part, part.open('wb') as file:
        np.savez(file, allow_pickle=False, header=text, **shaped)
    return len(drives)


def load_graph(path: Path, config: PoseGraphConfig) -> PoseGraph:
    """Return the graph of a file; MapError if it is damaged."""
    refuse_irregular(path)
    try:
        with zipfile.ZipFile(path) as parts:
            size = sum(part.file_size for part in parts.infolist())
        if size > _MOST_BYTES:
            raise ValueError(f'{size} bytes are too many')
        # np.load would leave a damaged file open if it were given the path.
        with path.open('rb') as file, np.load(file, allow_pickle=False) as stored:
            header = json.loads(bytes(stored['header']))
            arrays = {name: stored[name] for name in _SHAPES}
        return _graph(header, arrays, config)
    except Exception as error:
        raise MapError(
            f'{path}: not a whole graph ({one_line(error)}); move it away to begin a new one'
        ) from None


def map_of(path: Path) -> str:
    """Return the id of the map that a graph belongs to; empty if the file is not a graph."""
    try:
        with path.open('rb') as file, np.load(file, allow_pickle=False) as stored:
            return str(json.loads(bytes(stored['header']))['map_id'])
    except Exception:
        return ''


def _graph(header: dict[str, Any], arrays: dict[str, Any], config: PoseGraphConfig) -> PoseGraph:
    """Return the graph of checked arrays; any error if they do not fit each other."""
    if header['format'] != _FORMAT:
        raise ValueError(f'format {header["format"]}')
    for name, shape in _SHAPES.items():
        if arrays[name].shape[1:] != shape or not np.isfinite(arrays[name]).all():
            raise ValueError(name)
    full = {name: _squared(arrays[name]) for name in ('poses', 'solved', 'moved')}
    drives = []
    rows = zip(_spans(header['samples']), _spans(header['keyframes']), strict=True)
    for session, (samples, keys) in zip(header['sessions'], rows, strict=True):
        stamps, poses = arrays['stamps'][samples].tolist(), full['poses'][samples]
        spread = map(tuple, arrays['spread'][keys].tolist())
        drive = Odometry(
            config, str(session), stamps, poses, arrays['keyframes'][keys].tolist(), spread
        )
        count, numbers = len(drive.poses), drive.keyframes
        ascending = all(a < b for each in (drive.stamps, numbers) for a, b in pairwise(each))
        if not (ascending and numbers and 0 <= numbers[0] <= numbers[-1] < count):
            raise ValueError('keyframes')
        if len(drive.stamps) != count or len(drive.spread) != len(numbers):
            raise ValueError('stamps')
        drives.append(drive)
    end = 1 + len(arrays['keyframes'])
    for name in ('nodes', 'ends'):
        if not ((arrays[name] >= 0) & (arrays[name] < end)).all():
            raise ValueError(name)
    nodes = dict(zip(arrays['nodes'].tolist(), full['solved'], strict=True))
    graph = PoseGraph(config, drives, nodes=nodes)
    columns = (arrays[name] for name in ('ends', 'covariances', 'times', 'kept'))
    for (start, close), covariance, times, kept, moved, session in zip(
        *columns, full['moved'], header['references'], strict=True
    ):
        closure = Closure(int(times[0]), int(times[1]), moved, covariance, str(session))
        edge = Edge(int(start), int(close), moved, covariance, True)
        graph.known[closure.key] = Known(closure, edge, bool(kept))
    return graph


def _spans(counts: Iterable[int]) -> Iterator[slice]:
    ends = [0, *accumulate(counts)]
    return (slice(start, end) for start, end in pairwise(ends))


def _squared(rows: Matrix) -> Matrix:
    """Return motions (n, 3, 4) as matrices (n, 4, 4)."""
    result = np.tile(np.eye(4), (len(rows), 1, 1))
    result[:, :3] = rows
    return result


def write_tum(path: Path, stamped: Iterable[tuple[int, Pose]]) -> None:
    """Write stamped poses by time: seconds, position in metres, quaternion x y z w."""
    lines = []
    for stamp_ns, pose in sorted(stamped, key=lambda one: one[0]):
        seconds, rest = divmod(stamp_ns, 10**9)
        numbers = ' '.join(f'{value:.9g}' for value in (*pose.position, *pose.orientation))
        lines.append(f'{seconds}.{rest:09d} {numbers}')
    write_lines(path, lines)
