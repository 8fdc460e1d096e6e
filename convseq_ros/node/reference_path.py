# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The way of the drive that made the map last, on `~/reference_path`, for whoever comes late."""

from bisect import bisect_left
from collections.abc import Sequence
import math
import time

from convseq_ros.core.map.place import Place
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.node.conversions import pose_only_message, stamp_from_ns
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Header

_PERIOD_S = 5.0
_MOST_POSES = 5000


class ReferencePath:
    """
    Publishes the poses of a map when it is opened, and again every 5 s while it grows.

    Parameters
    ----------
    node : Node
        Whose private topic it is.

    """

    def __init__(self, node: Node) -> None:
        qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._publisher = node.create_publisher(Path, '~/reference_path', qos)
        self._told: tuple[ReferenceMap | None, int, float] = None, 0, 0.0

    def follow(self, reference_map: ReferenceMap, frame_id: str) -> None:
        """Publish the map's path if there is news; nothing if it has no poses."""
        told, length, told_s = self._told
        now_s = time.monotonic()
        if reference_map is told and (len(reference_map) == length or now_s - told_s < _PERIOD_S):
            return
        self._told = reference_map, len(reference_map), now_s
        message = path_message(reference_map, frame_id)
        if message.poses or told is not None:
            self._publisher.publish(message)


def path_message(reference_map: ReferenceMap, frame_id: str) -> Path:
    """
    Return the poses of the newest drive that has any, with their stamps, thinned out to 5000.

    A path is drawn as one line, and no line leads from one drive to the next.
    """
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
