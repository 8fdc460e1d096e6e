# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The messages of a closure: `~/closure`, all of it, and `~/closure_odometry`, for stock tools."""

import math
from uuid import UUID

from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Candidate, Match, RelativePose, UNKNOWN_M2
from convseq_ros.node.conversions import (
    cloud_message,
    match_header,
    pose_only_message,
    stamp_from_ns,
)
from convseq_ros.pose_graph.closures import told
from nav_msgs.msg import Odometry
import numpy as np
import numpy.typing as npt
from sensor_msgs.msg import PointCloud2

# `~/closure` is a PointCloud2 of one point. A reader in Python or C++ takes its fields by name
# (docs/BACKENDS.md), and new fields can be added at the end.
LAYOUT = 1  # of the fields below; it changes when one goes or means something else
# Fields of 8 bytes come first, then those of 4: each lies where its type wants it.
CLOSURE = np.dtype(
    [
        # Pose of the query's base in the reference's base frame, metres; NaN if not measured.
        *((name, '<f8') for name in ('x', 'y', 'z', 'qx', 'qy', 'qz', 'qw')),
        ('direction', '<f8', 3),  # of the position, unit vector, also where its length is unknown
        # Of x, y, z and turns about these axes, row by row; 1e6 if not measured.
        ('covariance', '<f8', 36),
        ('layout', '<u4'),
        ('query_sec', '<i4'),
        ('query_nanosec', '<u4'),
        ('reference_sec', '<i4'),
        ('reference_nanosec', '<u4'),
        ('query_id', '<u4'),  # frames answered before
        ('reference_id', '<u4'),  # index of the place in the map
        ('session', '<u4'),  # number of the place's session in the map, from 0
        ('confidence', '<f4'),  # probability in [0, 1] that the place is right; NaN if unknown
        ('inliers', '<u4'),  # correspondences that agree with the pose, or moved together
        ('map_id', '<u1', 16),  # the bytes of UUIDs
        ('reference_session', '<u1', 16),
        ('query_session', '<u1', 16),  # zero if this drive is not in the map
        ('overlap', '<f8'),  # share of both views that is common, in [0, 1]; NaN if unknown
    ]
)
"""The one row of `~/closure`."""

_NO_ID = UUID(int=0)


def closure_message(
    match: Match, reference_map: ReferenceMap, frame_id: str, session_start: int
) -> PointCloud2:
    """Return an accepted match as a closure; places from `session_start` on are of this drive."""
    accepted, reference_session, query_session = _ends(match, reference_map, session_start)
    row = np.zeros(1, CLOSURE)
    _write_pose(row, match.relative_pose)
    row['layout'] = LAYOUT
    for name, stamp_ns in (
        ('query', match.query_stamp_ns),
        ('reference', accepted.reference_stamp_ns),
    ):
        stamp = stamp_from_ns(stamp_ns)
        row[f'{name}_sec'], row[f'{name}_nanosec'] = stamp.sec, stamp.nanosec
    row['query_id'] = match.query_index % 2**32
    row['reference_id'] = accepted.reference_index
    row['confidence'] = math.nan if match.confidence is None else match.confidence
    row['overlap'] = math.nan if match.overlap is None else match.overlap
    measured = match.relative_pose
    row['inliers'] = measured.inliers if measured else accepted.inliers or 0
    row['session'] = accepted.session
    row['map_id'] = _bytes(reference_map.map_id)
    row['reference_session'] = _bytes(reference_session)
    row['query_session'] = _bytes(query_session)
    return cloud_message(row, match_header(match, frame_id), is_dense=False)


def closure_odometry_message(
    match: Match, reference_map: ReferenceMap, session_start: int
) -> Odometry:
    """
    Return an accepted match as the pose of the query in the reference, for tools that know us not.

    `header.frame_id` names the reference and `child_frame_id` the query, as `session/stamp_ns`;
    they are no TF frames. A query that is not in the map has no session. What is not measured has
    the variances that `told` gives.
    """
    accepted, reference, query = _ends(match, reference_map, session_start)
    message = Odometry(header=match_header(match, f'{reference}/{accepted.reference_stamp_ns}'))
    message.child_frame_id = f'{query}/{match.query_stamp_ns}'
    pose, covariance = told(match.relative_pose)
    message.pose.pose = pose_only_message(pose)
    message.pose.covariance = covariance.ravel()
    return message


def _ends(
    match: Match, reference_map: ReferenceMap, session_start: int
) -> tuple[Candidate, str, str]:
    """Return what was accepted, the id of its session, and of the query's; empty without one."""
    accepted, sessions = match.accepted, reference_map.sessions
    if accepted is None:
        raise ValueError('a closure needs an accepted match')
    is_in_map = session_start < len(reference_map)
    query = sessions[reference_map.places[-1].session].id if is_in_map else ''
    return accepted, sessions[accepted.session].id, query


def _write_pose(row: npt.NDArray[np.void], measured: RelativePose | None) -> None:
    nowhere = (math.nan,) * 3
    position = measured.position_m if measured else None
    direction = measured.direction if measured else None
    row['x'], row['y'], row['z'] = position or nowhere
    orientation = measured.orientation if measured else (math.nan,) * 4
    row['qx'], row['qy'], row['qz'], row['qw'] = orientation
    row['direction'] = direction or nowhere
    covariance = measured.covariance if measured else np.eye(6) * UNKNOWN_M2
    row['covariance'] = covariance.ravel()


def _bytes(ident: str) -> npt.NDArray[np.uint8]:
    """Return the bytes of a UUID; zeros if the text is not one."""
    try:
        uuid = UUID(ident)
    except ValueError:
        uuid = _NO_ID
    return np.frombuffer(uuid.bytes, np.uint8)
