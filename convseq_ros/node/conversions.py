# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Conversions from the records of the core to ROS messages; pure functions."""

from array import array
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
import math
import sys

from builtin_interfaces.msg import Time
from convseq_ros.app.result_row import row
from convseq_ros.core.map.place import Place
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Candidate, Match, Pose, PoseEstimate
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point, PoseStamped, PoseWithCovarianceStamped, Quaternion
from geometry_msgs.msg import Pose as PoseMessage
from nav_msgs.msg import Path
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


def path_message(poses: Iterable[tuple[int, Pose]], frame_id: str) -> Path:
    """Return stamps in ns and poses as a path; its own stamp is the last one, 0 without any."""
    stamped = [
        PoseStamped(
            header=Header(stamp=stamp_from_ns(stamp_ns), frame_id=frame_id),
            pose=pose_only_message(pose),
        )
        for stamp_ns, pose in poses
    ]
    stamp = stamped[-1].header.stamp if stamped else stamp_from_ns(0)
    return Path(header=Header(stamp=stamp, frame_id=frame_id), poses=stamped)


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
