# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What RViz and Foxglove draw."""

from unittest.mock import Mock

from convseq_ros.config import EVERY_FRAME
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.map.place import pack_cells, Place
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.pose.estimate import PoseEstimate
from convseq_ros.core.types import Candidate, Match, Pose, Reason, Status
from convseq_ros.node.conversions import stamp_to_ns
from convseq_ros.node.markers import MatchMarkers
import numpy as np
from visualization_msgs.msg import Marker

ACCEPTED = Match(3, 9, Status.ACCEPTED, Reason.ACCEPTED, (Candidate(5, 8, 0.75),), 2)
REJECTED = Match(4, 10, Status.REJECTED, Reason.WEAK, (Candidate(5, 8, 0.75),), 2)
BLANK = pack_cells(describe(np.zeros((64, 64), np.uint8)).cells)


def pose(x, y=0.0):
    return Pose((float(x), float(y), 0.0), (0.0, 0.0, 0.0, 1.0))


def map_of(*poses):
    reference_map = ReferenceMap(keyframes=EVERY_FRAME)
    for stamp, each in enumerate(poses):
        reference_map.add(Place(stamp, pose=each), BLANK)
    return reference_map


def estimate(x):
    return PoseEstimate(pose(x), np.eye(6))


def xs(marker):
    return [point.x for point in marker.points]


class Viewer:
    """What a `MatchMarkers` publishes."""

    def __init__(self, watchers=1):
        self.publisher = Mock()
        self.publisher.get_subscription_count.return_value = watchers
        node = Mock()
        node.create_publisher.return_value = self.publisher
        self.markers = MatchMarkers(node)

    def extract(self, *args):
        """Return the markers that are published for a frame, by namespace."""
        self.publisher.publish.reset_mock()
        self.markers.publish(*args, 'map')
        if not self.publisher.publish.called:
            return None
        (message,) = self.publisher.publish.call_args.args
        return {marker.ns: marker for marker in message.markers}


def test_nothing_is_built_for_nobody_and_closures_are_remembered():
    viewer, reference_map = Viewer(watchers=0), map_of(pose(0))
    assert viewer.extract(ACCEPTED, reference_map, estimate(1), pose(2)) is None
    viewer.publisher.get_subscription_count.return_value = 1
    drawn = viewer.extract(REJECTED, reference_map, None, None)
    assert xs(drawn['loop_edges']) == [2, 1]
    assert xs(drawn['places']) == [0]
    assert drawn['match'].action == Marker.DELETE


def test_only_news_is_drawn():
    viewer, reference_map = Viewer(), map_of(pose(0))
    assert len(viewer.extract(REJECTED, reference_map, None, None)) == 4
    assert viewer.extract(REJECTED, reference_map, None, None).keys() == {'match'}
    drawn = viewer.extract(ACCEPTED, reference_map, estimate(7), None)
    assert drawn.keys() == {'match', 'loop_nodes', 'loop_edges'}
    assert drawn['match'].pose.position.x == 7
    assert stamp_to_ns(drawn['match'].header.stamp) == ACCEPTED.query_stamp_ns
    for index in range(10):
        reference_map.add(Place(index, pose=pose(index)), BLANK)
    assert xs(viewer.extract(REJECTED, reference_map, None, None)['places']) == [0, *range(10)]
    viewer.publisher.get_subscription_count.return_value = 2
    assert len(viewer.extract(REJECTED, reference_map, None, None)) == 4
