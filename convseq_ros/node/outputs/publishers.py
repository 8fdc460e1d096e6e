# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The topics on which the node publishes for every frame."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from convseq_ros.app.match_picture import answer_picture
from convseq_ros.config.node_config import NodeConfig
from convseq_ros.core.pose.estimate import with_map_errors
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.types import Candidate, Frame, Match, PoseEstimate
from convseq_ros.node.conversions import (
    answer_message,
    candidates_message,
    image_message,
    is_old_enough,
    loop_closure_message,
    match_header,
    pose_message,
)
from convseq_ros.node.outputs.closure_messages import closure_message, closure_odometry_message
from convseq_ros.node.outputs.map_topics import MapTopics, MatchMarkers
from convseq_ros.node.qos import advertise
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import Float32, Float64MultiArray, Int32, Int64MultiArray, UInt32

_KINDS = {
    '~/answer': DiagnosticArray,
    '~/match_index': Int32,
    '~/match_score': Float32,
    '~/confidence': Float32,
    '~/latency_ms': Float32,
    '~/sequence_length': UInt32,
    '~/candidates': PointCloud2,
    '~/loop_closure': Float64MultiArray,
    '~/loop_closure_index': Int64MultiArray,
    '~/closure': PointCloud2,
    '~/closure_odometry': Odometry,
    '~/pose': PoseWithCovarianceStamped,
    '~/debug_image': Image,
}


@dataclass(frozen=True, eq=False, slots=True)
class Answered:
    """A frame and its answer."""

    frame: Frame
    match: Match
    recognizer: PlaceRecognizer  # that made it; for its map, and what a picture of it shows
    session_start: int  # places of the map from this index on are of the running drive
    model_ms: float  # of the work: that of the descriptor model
    duration_ms: float  # of the work
    latency_ms: float  # since the image arrived

    def position_sigma_m(self, config: NodeConfig) -> float:
        """Return the standard deviation of positions in the map: the larger one that is told."""
        return max(config.position_sigma_m, self.recognizer.reference_map.position_sigma_m)


class MatchPublishers:
    """The topics of results; a message is made only if somebody subscribes to its topic."""

    def __init__(self, node: Node, config: NodeConfig, odometry_frame: Callable[[], str]) -> None:
        self._config = config
        self._odometry_frame = odometry_frame
        self._publishers = {name: advertise(node, kind, name) for name, kind in _KINDS.items()}
        self._markers = MatchMarkers(node)
        self.map_topics = MapTopics(node)

    def configure(self, config: NodeConfig) -> None:
        """Use other settings from now on."""
        self._config = config

    def publish(self, answered: Answered) -> PoseEstimate | None:
        """Publish the answer to a frame, -1 and 0 for none; return the estimated pose, if any."""
        frame, match, config, send = answered.frame, answered.match, self._config, self._send
        best, accepted = match.best, match.accepted
        reference_map, map_frame = answered.recognizer.reference_map, config.map_frame
        took_ms, model_ms = answered.duration_ms, answered.model_ms
        answer = partial(answer_message, match, took_ms, reference_map, map_frame, model_ms)
        send('~/answer', answer)
        send('~/match_index', lambda: Int32(data=accepted.reference_index if accepted else -1))
        send('~/match_score', lambda: Float32(data=best.score if best else 0.0))
        send('~/confidence', lambda: Float32(data=match.confidence or 0.0))
        send('~/latency_ms', lambda: Float32(data=answered.latency_ms))
        send('~/sequence_length', lambda: UInt32(data=match.sequence_length))
        send('~/candidates', partial(candidates_message, match, reference_map.places, map_frame))
        estimate = self._publish_accepted(answered, accepted) if accepted else None
        self.map_topics.follow(reference_map, map_frame)
        # Odometry is in the map's frame if its frame id says so, or if this drive made the place.
        shared = self._odometry_frame() == map_frame or (
            accepted is not None and accepted.reference_index >= answered.session_start
        )
        query = frame.pose if shared else None
        self._markers.publish(match, reference_map, estimate, query, map_frame)
        send('~/debug_image', partial(_debug_image, frame, match, answered.recognizer))
        return estimate

    def _send(self, name: str, make: Callable[[], Any]) -> None:
        publisher = self._publishers[name]
        if publisher.get_subscription_count():
            publisher.publish(make())

    def _publish_accepted(self, answered: Answered, accepted: Candidate) -> PoseEstimate | None:
        match, config, recognizer = answered.match, self._config, answered.recognizer
        reference_map, frame = recognizer.reference_map, config.base_frame
        start = answered.session_start
        stamp_ns, is_own = match.query_stamp_ns, accepted.reference_index >= start
        # Places of earlier drives in a growing map have stamps of another clock.
        if is_old_enough(stamp_ns, accepted) if is_own else not recognizer.config.online.grows:
            self._send('~/loop_closure', partial(loop_closure_message, stamp_ns, accepted))
        pair = [match.query_index, accepted.reference_index]
        self._send('~/loop_closure_index', lambda: Int64MultiArray(data=pair))
        self._send('~/closure', partial(closure_message, match, reference_map, frame, start))
        self._send(
            '~/closure_odometry', partial(closure_odometry_message, match, reference_map, start)
        )
        place = reference_map.places[accepted.reference_index].pose
        if match.pose is None or place is None:
            return None
        sigma_m, sigma_rad = answered.position_sigma_m(config), config.heading_sigma_rad
        estimate = with_map_errors(match.pose, place, sigma_m, sigma_rad)
        self._send('~/pose', partial(pose_message, match, estimate, config.map_frame))
        return estimate


def _debug_image(frame: Frame, match: Match, recognizer: PlaceRecognizer) -> Image:
    header = match_header(match, frame.frame_id)
    return image_message(answer_picture(frame, match, recognizer), header)
