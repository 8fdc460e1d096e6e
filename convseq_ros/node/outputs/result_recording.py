# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Records what the node would publish, without a node: `replay --output FILE.mcap`."""

from contextlib import ExitStack
from pathlib import Path
from typing import Any, Self

from convseq_ros.config.node_config import NodeConfig
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.types import Frame, Match
from convseq_ros.io.output_file import LIBRARY
from convseq_ros.io.regular_file import complete_or_absent
from convseq_ros.node.conversions import type_name
from convseq_ros.node.outputs.publishers import Answered, MatchPublishers
from convseq_ros.sources.topics import typestore
from rclpy.serialization import serialize_message

_NODE = '/vpr_node'


class ResultRecording:
    """Writes the node's topics to an mcap file, with the stamps of the frames."""

    def __init__(self, path: Path) -> None:
        self._path, self._stamp_ns = path, 0
        self._opened = ExitStack()

    def __enter__(self) -> Self:
        # Imported here because the node does not need it, and Ubuntu does not package it.
        from mcap.writer import Writer

        part = self._opened.enter_context(complete_or_absent(self._path))
        self._writer: Any = Writer(self._opened.enter_context(part.open('wb')))
        self._writer.start(profile='ros2', library=LIBRARY)
        self._opened.callback(self._writer.finish)
        self._publishers = MatchPublishers(self, NodeConfig(), str)  # type: ignore[arg-type]
        return self

    def __exit__(self, *error: Any) -> None:
        self._opened.__exit__(*error)

    def write(
        self, frame: Frame, match: Match, recognizer: PlaceRecognizer, duration_ms: float
    ) -> None:
        self._stamp_ns = match.query_stamp_ns
        # Offline no image waits: its latency is the time that it takes.
        start, took_ms = recognizer.mapping.session_start, (recognizer.model_ms, duration_ms)
        self._publishers.publish(Answered(frame, match, recognizer, start, *took_ms, duration_ms))

    def create_publisher(self, kind: type, topic: str, _qos: Any, **_events: Any) -> '_Channel':
        """Return a publisher that writes to the file."""
        name = type_name(kind)
        described, _ = typestore().generate_msgdef(name, ros_version=2)
        schema = self._writer.register_schema(name, 'ros2msg', described.encode())
        return _Channel(
            self, self._writer.register_channel(topic.replace('~', _NODE, 1), 'cdr', schema)
        )

    def add(self, channel: int, message: Any) -> None:
        data = serialize_message(message)
        self._writer.add_message(channel, self._stamp_ns, data, self._stamp_ns)


class _Channel:
    """A publisher with the methods that the node's parts use."""

    def __init__(self, recording: ResultRecording, number: int) -> None:
        self._recording, self._number = recording, number

    def publish(self, message: Any) -> None:
        self._recording.add(self._number, message)

    def get_subscription_count(self) -> int:
        """Return 1, so that every message is made, also pictures."""
        return 1
