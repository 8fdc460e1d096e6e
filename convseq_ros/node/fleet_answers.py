# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a fleet says of each frame, beside the node's own map."""

from collections.abc import Sequence

from convseq_ros.config import Config
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.types import Match
from convseq_ros.fleet.cluster import Cluster
from convseq_ros.fleet.link import FleetLink
from convseq_ros.node.conversions import answer_message
from convseq_ros.node.topics import advertise
from convseq_ros.node_config import NodeConfig
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

TIMEOUT_S = 1.0  # after which a fleet is given up, and looked for again


def open_fleet(
    node: Node, settings: NodeConfig, config: Config, sources: Sequence[str] = ()
) -> FleetLink | None:
    """
    Have each frame's answer of a fleet published on `~/fleet_answer`, if one is asked for.

    FleetError if its address is none, or may not be talked to.
    """
    if not settings.fleet:
        return None
    publisher = advertise(node, DiagnosticArray, '~/fleet_answer')

    def publish(match: Match, duration_ms: float, recognizer: PlaceRecognizer) -> None:
        if node.context.ok():
            publisher.publish(
                answer_message(match, duration_ms, recognizer.reference_map, settings.map_frame)
            )

    return FleetLink(Cluster(settings.fleet), config, publish, TIMEOUT_S, sources)
