# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the node says about every frame."""

from convseq_ros.config import NodeConfig
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.reference_map import ReferenceMap
from convseq_ros.core.types import Candidate, Frame, Match
from convseq_ros.node.conversions import (
    candidates_message,
    image_message,
    loop_closure_index_message,
    loop_closure_message,
    match_header,
    pose_message,
)
from convseq_ros.node.debug_image import debug_image
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.node import Node
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import Float32, Float64MultiArray, Int32, Int64MultiArray, UInt32

_DEPTH = 10


class MatchPublishers:
    """
    The topics of results.

    Parameters
    ----------
    node : Node
        Whose private topics they are.
    config : NodeConfig
        Frame and uncertainty of poses; may be replaced between two frames.

    """

    def __init__(self, node: Node, config: NodeConfig) -> None:
        self.config = config
        self._index = node.create_publisher(Int32, '~/match_index', _DEPTH)
        self._score = node.create_publisher(Float32, '~/match_score', _DEPTH)
        self._length = node.create_publisher(UInt32, '~/sequence_length', _DEPTH)
        self._candidates = node.create_publisher(PointCloud2, '~/candidates', _DEPTH)
        self._closure = node.create_publisher(Float64MultiArray, '~/loop_closure', _DEPTH)
        self._closure_index = node.create_publisher(
            Int64MultiArray, '~/loop_closure_index', _DEPTH
        )
        self._pose = node.create_publisher(PoseWithCovarianceStamped, '~/pose', _DEPTH)
        self._debug_image = node.create_publisher(Image, '~/debug_image', _DEPTH)

    def publish(self, frame: Frame, match: Match, recognizer: PlaceRecognizer) -> None:
        """Publish the answer to one frame; -1 and 0 stand for no match and no score."""
        best, accepted = match.best, match.accepted
        places = recognizer.reference_map.places
        poses = {item.reference_index: places[item.reference_index].pose
                 for item in match.candidates}
        self._index.publish(Int32(data=accepted.reference_index if accepted else -1))
        self._score.publish(Float32(data=best.score if best else 0.0))
        self._length.publish(UInt32(data=match.sequence_length))
        self._candidates.publish(candidates_message(match, poses, self.config.map_frame))
        if accepted:
            self._publish_accepted(match, accepted, recognizer.reference_map)
        if self._debug_image.get_subscription_count():
            place = places[best.reference_index] if best else None
            picture = debug_image(frame, match, place, recognizer.agreement(match))
            header = match_header(match, '')
            self._debug_image.publish(image_message(picture, header))

    def _publish_accepted(
        self, match: Match, accepted: Candidate, reference_map: ReferenceMap
    ) -> None:
        config = self.config
        self._closure.publish(loop_closure_message(match.query_stamp_ns, accepted))
        self._closure_index.publish(loop_closure_index_message(match.query_index, accepted))
        pose = reference_map.places[accepted.reference_index].pose
        if pose:
            sigmas = config.position_sigma_m, config.heading_sigma_rad
            self._pose.publish(pose_message(match, pose, config.map_frame, *sigmas))
