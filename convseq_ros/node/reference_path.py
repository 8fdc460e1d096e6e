# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The way of the drive that made the map last, on `~/reference_path`, for whoever comes late."""

from bisect import bisect_left
from collections.abc import Sequence
import math

from convseq_ros.core.map.place import Place
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.node.conversions import pose_only_message, stamp_from_ns
from convseq_ros.node.map_news import MapNews
from convseq_ros.node.qos import LATCHED
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rclpy.node import Node
from std_msgs.msg import Header

_MOST_POSES = 5000


class ReferencePath:
    """Publishes the poses of a map when it is opened, and again every 5 s while it grows."""

    def __init__(self, node: Node) -> None:
        self._publisher = node.create_publisher(Path, '~/reference_path', LATCHED)
        self._news = MapNews()

    def follow(self, reference_map: ReferenceMap, frame_id: str) -> None:
        """Publish the map's path if there is news; nothing if it has no poses."""
        is_first = self._news.told is None
        if self._news.update(reference_map):
            message = path_message(reference_map, frame_id)
            if message.poses or not is_first:
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
