# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which map is in use, and the path of the drive that made it last, for whoever comes late."""

from bisect import bisect_left
from collections.abc import Sequence
import math
import time

from convseq_ros.core.map.format import FORMAT_VERSION
from convseq_ros.core.map.place import Place
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.node.conversions import pose_only_message, row_message, stamp_from_ns
from convseq_ros.node.topics import advertise, LATCHED
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rclpy.node import Node
from std_msgs.msg import Header

_PERIOD_S = 5.0
_MOST_POSES = 5000


class MapTopics:
    """Publishes `~/map_info` and `~/reference_path` at once, and every 5 s while a map grows."""

    def __init__(self, node: Node) -> None:
        self._info = advertise(node, DiagnosticArray, '~/map_info', LATCHED)
        self._path = advertise(node, Path, '~/reference_path', LATCHED)
        self._shown: ReferenceMap | None = None
        self._length = self._posed = 0
        self._shown_s = 0.0
        self._has_path = False

    def follow(self, reference_map: ReferenceMap, frame_id: str) -> None:
        """Publish, if there is news; the path if it has poses, or if an earlier one had."""
        length, now_s = len(reference_map), time.monotonic()
        if reference_map is not self._shown:
            self._shown, self._length, self._posed = reference_map, 0, 0
        elif length == self._length or now_s - self._shown_s < _PERIOD_S:
            return
        new = reference_map.places[self._length : length]
        self._posed += sum(place.pose is not None for place in new)
        self._length, self._shown_s = length, now_s
        self._info.publish(map_info_message(reference_map, self._posed, frame_id))
        message = path_message(reference_map, frame_id)
        if message.poses or self._has_path:
            self._path.publish(message)
        self._has_path = bool(message.poses)


def map_info_message(reference_map: ReferenceMap, posed: int, frame_id: str) -> DiagnosticArray:
    """Return what a map is, of whose places so many have a pose."""
    places, sessions = reference_map.places, reference_map.sessions
    values: dict[str, object] = {
        'map_id': reference_map.map_id,
        'format': FORMAT_VERSION,
        'places': len(places),
        'with_pose': posed,
        'sessions': len(sessions),
        'session_ids': ' '.join(session.id for session in sessions),
        'first_stamp_ns': places[0].stamp_ns if places else None,
        'last_stamp_ns': places[-1].stamp_ns if places else None,
        **reference_map.keyframes.spacing,
    }
    stamp = stamp_from_ns(places[-1].stamp_ns if places else 0)
    text = f'{len(places)} places, {posed} with a pose'
    return row_message(Header(stamp=stamp, frame_id=frame_id), text, values)


def path_message(reference_map: ReferenceMap, frame_id: str) -> Path:
    """Return the poses of the newest drive that has any, thinned out to 5000, as one line."""
    poses = [
        PoseStamped(
            header=Header(stamp=stamp_from_ns(place.stamp_ns), frame_id=frame_id),
            pose=pose_only_message(place.pose),
        )
        for place in _newest_drive(reference_map.places)
        if place.pose
    ]
    stamp = poses[-1].header.stamp if poses else stamp_from_ns(0)
    return Path(header=Header(stamp=stamp, frame_id=frame_id), poses=poses)


def _newest_drive(places: Sequence[Place]) -> Sequence[Place]:
    end = len(places)
    while end:
        session = places[end - 1].session
        start = bisect_left(places, session, 0, end, key=lambda place: place.session)
        step = max(1, math.ceil((end - start) / _MOST_POSES))
        drive = places[start:end:step]
        if any(place.pose for place in drive):
            return drive
        end = start
    return ()
