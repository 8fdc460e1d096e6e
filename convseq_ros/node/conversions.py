# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Conversions from the records of the core to ROS messages; pure functions."""

from array import array
from collections.abc import Mapping, Sequence
from functools import cache
import math
import sys
from uuid import UUID

from builtin_interfaces.msg import Time
from convseq_ros.core.map.place import Place
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.result_row import row
from convseq_ros.core.types import Candidate, Match, Pose, PoseEstimate, RelativePose, UNKNOWN_M2
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point, PoseWithCovarianceStamped, Quaternion
from geometry_msgs.msg import Pose as PoseMessage
from nav_msgs.msg import Odometry
import numpy as np
import numpy.typing as npt
from sensor_msgs.msg import Image, PointCloud2, PointField
from std_msgs.msg import Float64MultiArray, Header

_NS = 1_000_000_000
_FIRST_NS, _LAST_NS = -(2**31) * _NS, 2**31 * _NS - 1  # builtin_interfaces/Time: int32 seconds
_NOWHERE = (math.nan, math.nan, math.nan)
# Minimum age of a place of the running drive in a pair of `~/loop_closure`. LIO-SAM drops younger
# pairs (its `historyKeyframeSearchTimeDiff`), and takes only one pair a second.
_LOOP_CLOSURE_AGE_NS = 30 * _NS

CANDIDATE = np.dtype(
    [(name, '<f4') for name in ('x', 'y', 'z', 'score')]
    + [('index', '<u4'), ('length', '<u4'), ('stamp_sec', '<i4'), ('stamp_nanosec', '<u4')]
    + [('session', '<u4')]
)
"""One row of `~/candidates`."""

_FIELD_TYPES = {
    'f8': PointField.FLOAT64,
    'f4': PointField.FLOAT32,
    'u4': PointField.UINT32,
    'i4': PointField.INT32,
    'u1': PointField.UINT8,
}


def stamp_to_ns(stamp: Time) -> int:
    return int(stamp.sec) * _NS + int(stamp.nanosec)


def stamp_from_ns(stamp_ns: int) -> Time:
    """Return nanoseconds as a stamp; the nearest one, if its seconds do not fit into 32 bits."""
    sec, nanosec = divmod(min(max(stamp_ns, _FIRST_NS), _LAST_NS), _NS)
    return Time(sec=sec, nanosec=nanosec)


def answer_message(
    match: Match,
    duration_ms: float,
    reference_map: ReferenceMap,
    frame_id: str,
    model_ms: float = 0.0,
) -> DiagnosticArray:
    """Return a row of the result table as names and values, with the ids of map and session."""
    values = {**row(match, duration_ms), 'map_id': reference_map.map_id}
    if reference_map.encoding.descriptor_model:
        values['model_ms'] = round(model_ms, 3)
    if match.best:
        values['session_id'] = reference_map.sessions[match.best.session].id
    return row_message(match_header(match, frame_id), match.reason.value, values)


def row_message(header: Header, text: str, values: Mapping[str, object]) -> DiagnosticArray:
    """Return names and values, one of them `map_id`, in one message; None is an empty text."""
    pairs = [
        KeyValue(key=name, value='' if value is None else str(value))
        for name, value in values.items()
    ]
    source = {'name': 'convseq_ros', 'hardware_id': str(values['map_id'])}
    status = DiagnosticStatus(level=DiagnosticStatus.OK, message=text, values=pairs, **source)
    return DiagnosticArray(header=header, status=[status])


def candidates_message(match: Match, places: Sequence[Place], frame_id: str) -> PointCloud2:
    """Return the candidates, best first, a point each; NaN for a place without a pose."""
    rows = np.zeros(len(match.candidates), CANDIDATE)
    poses = [places[candidate.reference_index].pose for candidate in match.candidates]
    for number, (candidate, pose) in enumerate(zip(match.candidates, poses, strict=True)):
        stamp = stamp_from_ns(candidate.reference_stamp_ns)
        x, y, z = pose.position if pose else _NOWHERE
        index, score = candidate.reference_index, candidate.score
        length, session = match.sequence_length, candidate.session
        rows[number] = (x, y, z, score, index, length, stamp.sec, stamp.nanosec, session)
    return cloud_message(rows, match_header(match, frame_id), all(poses))


def is_old_enough(query_stamp_ns: int, accepted: Candidate) -> bool:
    """Return whether a place of the running drive is old enough for `~/loop_closure`."""
    return query_stamp_ns - accepted.reference_stamp_ns >= _LOOP_CLOSURE_AGE_NS


def loop_closure_message(query_stamp_ns: int, accepted: Candidate) -> Float64MultiArray:
    """Return both stamps in seconds, exactly two numbers: query, reference."""
    stamps = query_stamp_ns / _NS, accepted.reference_stamp_ns / _NS
    return Float64MultiArray(data=list(stamps))


def point_message(position: tuple[float, float, float]) -> Point:
    x, y, z = position
    return Point(x=x, y=y, z=z)


def pose_only_message(pose: Pose) -> PoseMessage:
    x, y, z, w = pose.orientation
    return PoseMessage(
        position=point_message(pose.position), orientation=Quaternion(x=x, y=y, z=z, w=w)
    )


def pose_message(match: Match, estimate: PoseEstimate, frame_id: str) -> PoseWithCovarianceStamped:
    """Return where the camera is at the time of the query, in a frame."""
    message = PoseWithCovarianceStamped(header=match_header(match, frame_id))
    message.pose.pose = pose_only_message(estimate.pose)
    message.pose.covariance = estimate.covariance.ravel()
    return message


def image_message(bgr: npt.NDArray[np.uint8], header: Header) -> Image:
    """Return a picture, uint8 of shape (H, W, 3) as bgr8 or (H, W) as mono8, as a message."""
    height, width = bgr.shape[:2]
    return Image(
        header=header,
        height=height,
        width=width,
        encoding='bgr8' if bgr.ndim == 3 else 'mono8',
        is_bigendian=sys.byteorder == 'big',
        step=bgr.nbytes // height,
        data=array('B', bgr.tobytes()),
    )


def status_message(
    level: bytes, name: str, text: str, values: Mapping[str, object], hardware_id: str
) -> DiagnosticStatus:
    """Return one entry of /diagnostics; numbers keep three decimals."""
    pairs = [
        KeyValue(key=key, value=f'{value:.3f}' if isinstance(value, float) else str(value))
        for key, value in values.items()
    ]
    return DiagnosticStatus(
        level=level, name=name, message=text, hardware_id=hardware_id, values=pairs
    )


def match_header(match: Match, frame_id: str) -> Header:
    """Return the stamp of the query in a frame."""
    return Header(stamp=stamp_from_ns(match.query_stamp_ns), frame_id=frame_id)


def cloud_message(rows: npt.NDArray[np.void], header: Header, is_dense: bool) -> PointCloud2:
    """Return rows (points,), little-endian, one point each; dense if no number is NaN."""
    return PointCloud2(
        header=header,
        height=1,
        width=len(rows),
        fields=cloud_fields(rows.dtype),
        is_bigendian=False,
        point_step=rows.dtype.itemsize,
        row_step=rows.nbytes,
        data=array('B', rows.tobytes()),
        is_dense=is_dense,
    )


@cache
def cloud_fields(row: np.dtype[np.void]) -> list[PointField]:
    """Return the fields of the points of a message."""
    fields = []
    for name, (kind, offset, *_) in (row.fields or {}).items():
        datatype, count = _FIELD_TYPES[kind.base.str[1:]], math.prod(kind.shape)
        fields.append(PointField(name=name, offset=offset, datatype=datatype, count=count))
    return fields


@cache
def type_name(kind: type) -> str:
    """Return the name of a message's type on the ROS graph, such as sensor_msgs/msg/Image."""
    return f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}'


# `~/closure` is a PointCloud2 of one point. A reader in Python or C++ takes its fields by name
# (docs/backends/README.md), and new fields can be added at the end.
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
    ]
)
"""The one row of `~/closure`."""

_NO_ID = UUID(int=0)
UNKNOWN_RAD2 = 10.0  # variance of a turn that is not measured


def closure_message(
    match: Match, reference_map: ReferenceMap, frame_id: str, session_start: int
) -> PointCloud2:
    """Return an accepted match as a closure; places from `session_start` on are of this drive."""
    accepted = match.accepted
    if accepted is None:
        raise ValueError('a closure needs an accepted match')
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
    measured = match.relative_pose
    row['inliers'] = measured.inliers if measured else accepted.inliers or 0
    place = reference_map.places[accepted.reference_index]
    row['session'] = place.session
    row['map_id'] = _bytes(reference_map.map_id)
    row['reference_session'] = _bytes(reference_map.sessions[place.session].id)
    if session_start < len(reference_map):
        newest = reference_map.places[len(reference_map) - 1]
        row['query_session'] = _bytes(reference_map.sessions[newest.session].id)
    return cloud_message(row, match_header(match, frame_id), is_dense=False)


def closure_odometry_message(
    match: Match, reference_map: ReferenceMap, session_start: int
) -> Odometry:
    """
    Return an accepted match as the pose of the query in the reference, for tools that know us not.

    `header.frame_id` names the reference and `child_frame_id` the query, as `session/stamp_ns`;
    they are no TF frames. A query that is not in the map has no session. Without a measured
    position it is zero, with a variance of 1e6 m2; without a measured turn, of 10 rad2.
    """
    accepted = match.accepted
    if accepted is None:
        raise ValueError('a closure needs an accepted match')
    place = reference_map.places[accepted.reference_index]
    reference, newest = reference_map.sessions[place.session].id, ''
    if session_start < len(reference_map):
        newest = reference_map.sessions[reference_map.places[len(reference_map) - 1].session].id
    message = Odometry(header=match_header(match, f'{reference}/{accepted.reference_stamp_ns}'))
    message.child_frame_id = f'{newest}/{match.query_stamp_ns}'
    covariance = np.diag([UNKNOWN_M2] * 3 + [UNKNOWN_RAD2] * 3)
    pose = Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    if measured := match.relative_pose:
        pose = Pose(measured.position_m or pose.position, measured.orientation)
        covariance[3:, 3:] = measured.covariance[3:, 3:]
        if measured.position_m:
            covariance = measured.covariance
    message.pose.pose = pose_only_message(pose)
    message.pose.covariance = covariance.ravel()
    return message


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
