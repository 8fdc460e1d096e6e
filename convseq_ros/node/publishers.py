# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the node says about every frame."""

from collections.abc import Callable

from convseq_ros.core.encoding.view import upright
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.pose.estimate import estimate_pose, PoseEstimate
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.types import Candidate, Frame, Match
from convseq_ros.evaluation.match_picture import match_picture
from convseq_ros.node.answer import answer_message, MapInfo
from convseq_ros.node.closure_message import closure_message
from convseq_ros.node.conversions import (
    candidates_message,
    image_message,
    loop_closure_index_message,
    loop_closure_message,
    match_header,
    pose_message,
)
from convseq_ros.node.markers import MatchMarkers
from convseq_ros.node.reference_path import ReferencePath
from convseq_ros.node_config import NodeConfig
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.node import Node
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import Float32, Float64MultiArray, Int32, Int64MultiArray, UInt32

_DEPTH = 10


class MatchPublishers:
    """
    The topics of results.

    `config` may be replaced between two frames; `odometry_frame` tells the frame in which poses of
    frames are given.
    """

    def __init__(self, node: Node, config: NodeConfig, odometry_frame: Callable[[], str]) -> None:
        self.config = config
        self._odometry_frame = odometry_frame
        self._answer = node.create_publisher(DiagnosticArray, '~/answer', _DEPTH)
        self._index = node.create_publisher(Int32, '~/match_index', _DEPTH)
        self._score = node.create_publisher(Float32, '~/match_score', _DEPTH)
        self._length = node.create_publisher(UInt32, '~/sequence_length', _DEPTH)
        self._candidates = node.create_publisher(PointCloud2, '~/candidates', _DEPTH)
        self._closure = node.create_publisher(Float64MultiArray, '~/loop_closure', _DEPTH)
        self._closure_index = node.create_publisher(
            Int64MultiArray, '~/loop_closure_index', _DEPTH
        )
        self._whole_closure = node.create_publisher(PointCloud2, '~/closure', _DEPTH)
        self._pose = node.create_publisher(PoseWithCovarianceStamped, '~/pose', _DEPTH)
        self._debug_image = node.create_publisher(Image, '~/debug_image', _DEPTH)
        self._markers = MatchMarkers(node)
        self._path = ReferencePath(node)
        self._map_info = MapInfo(node)

    def follow(self, reference_map: ReferenceMap) -> None:
        """Show another map."""
        self._path.follow(reference_map, self.config.map_frame)
        self._map_info.follow(reference_map, self.config.map_frame)

    def publish(
        self, frame: Frame, match: Match, recognizer: PlaceRecognizer, duration_ms: float
    ) -> PoseEstimate | None:
        """
        Publish the answer to one frame, and return the pose that was, if any.

        -1 and 0 stand for no match and no score.
        """
        best, accepted = match.best, match.accepted
        places = recognizer.reference_map.places
        poses = {
            item.reference_index: places[item.reference_index].pose for item in match.candidates
        }
        map_, own = recognizer.reference_map, self.config
        told = answer_message(match, duration_ms, map_, own.map_frame, recognizer.model_ms)
        self._answer.publish(told)
        self._index.publish(Int32(data=accepted.reference_index if accepted else -1))
        self._score.publish(Float32(data=best.score if best else 0.0))
        self._length.publish(UInt32(data=match.sequence_length))
        self._candidates.publish(candidates_message(match, poses, self.config.map_frame))
        estimate = None
        if accepted:
            estimate = self._publish_accepted(match, accepted, recognizer)
        self._show(frame, match, recognizer, estimate)
        return estimate

    def _publish_accepted(
        self, match: Match, accepted: Candidate, recognizer: PlaceRecognizer
    ) -> PoseEstimate | None:
        config = self.config
        if not self._is_of_another_session(accepted, recognizer):
            self._closure.publish(loop_closure_message(match.query_stamp_ns, accepted))
        self._closure_index.publish(loop_closure_index_message(match.query_index, accepted))
        own = recognizer.mapping.session_start
        self._whole_closure.publish(
            closure_message(match, recognizer.reference_map, config.base_frame, own)
        )
        estimate = estimate_pose(
            recognizer.reference_map.places,
            accepted.reference_index,
            yaw_rad=match.relative_yaw_rad,
            relative=match.relative_pose,
            row=recognizer.buffer.row,
            position_sigma_m=config.position_sigma_m,
            heading_sigma_rad=config.heading_sigma_rad,
        )
        if estimate:
            self._pose.publish(pose_message(match, estimate, config.map_frame))
        return estimate

    def _show(
        self,
        frame: Frame,
        match: Match,
        recognizer: PlaceRecognizer,
        estimate: PoseEstimate | None,
    ) -> None:
        """Publish what people look at."""
        reference_map, accepted = recognizer.reference_map, match.accepted
        self.follow(reference_map)
        # Odometry is given in the map's frame if it says so, or if this session made the place.
        shared = self._odometry_frame() == self.config.map_frame or (
            accepted is not None and accepted.reference_index >= recognizer.mapping.session_start
        )
        self._markers.publish(
            match, reference_map, estimate, frame.pose if shared else None, self.config.map_frame
        )
        if self._debug_image.get_subscription_count():
            best = match.best
            thumbnail = reference_map.thumbnail(best.reference_index) if best else b''
            shown = upright(frame, reference_map.encoding)
            picture = match_picture(shown, match, thumbnail, recognizer.buffer.field(best))
            self._debug_image.publish(image_message(picture, match_header(match, '')))

    def _is_of_another_session(self, accepted: Candidate, recognizer: PlaceRecognizer) -> bool:
        """Return whether a growing map had the place already: its stamp is of another clock."""
        grows = recognizer.config.online.grows
        return grows and accepted.reference_index < recognizer.mapping.session_start
