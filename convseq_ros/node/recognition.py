# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The work on one frame, done in the worker's thread: decode, recognise, record, publish."""

from collections.abc import Callable
from dataclasses import dataclass, replace
import time
import traceback
from typing import Any

from convseq_ros.config import Config
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.types import Frame, Match
from convseq_ros.errors import ConvseqError, ImageError
from convseq_ros.node.result_log import ResultLog
from convseq_ros.node.statistics import Statistics
from convseq_ros.sources.images import decode_compressed, decode_image
from sensor_msgs.msg import CompressedImage, Image

_LOG_PERIOD_S = 5.0

Publish = Callable[[Frame, Match, PlaceRecognizer], None]


@dataclass(frozen=True, slots=True)
class Arrival:
    """
    A message as it came in.

    Parameters
    ----------
    message : Image or CompressedImage
        The image, not yet decoded.
    stamp_ns : int
        When it was taken, nanoseconds.
    arrival_ns : int
        Monotonic time at which it came.
    topic : str
        Where it came from.

    """

    message: Image | CompressedImage
    stamp_ns: int
    arrival_ns: int
    topic: str


class Recognition:
    """
    Answers frame after frame; no frame, however broken, stops it.

    Parameters
    ----------
    recognizer : PlaceRecognizer
        With the map of the start.
    results : ResultLog
        Gets a row for every answer.
    publish : callable
        Receives every answer, with its frame and who gave it.
    statistics : Statistics
        Where answers and failures are counted.
    logger : rclpy logger
        Told about failures.
    ros_is_up : callable
        False when the node is about to end.

    """

    def __init__(
        self,
        recognizer: PlaceRecognizer,
        results: ResultLog,
        publish: Publish,
        statistics: Statistics,
        logger: Any,
        ros_is_up: Callable[[], bool],
    ) -> None:
        self._recognizer = recognizer
        self._results = results
        self._publish = publish
        self._statistics = statistics
        self._logger = logger
        self._ros_is_up = ros_is_up
        self._frames = 0

    def handle(self, arrival: Arrival) -> None:
        """Answer one frame; errors are logged and counted."""
        try:
            self._answer(arrival)
        except ConvseqError as error:
            self._statistics.failed += 1
            self._logger.error(str(error), throttle_duration_sec=_LOG_PERIOD_S)
        except Exception:
            # Publishing fails while a signal shuts ROS down; the row is written by then.
            if self._ros_is_up():
                self._statistics.failed += 1
                self._logger.error(traceback.format_exc(), throttle_duration_sec=_LOG_PERIOD_S)

    def swap(self, recognizer: PlaceRecognizer) -> None:
        """Go on with another recogniser, and so another map."""
        recognizer.config = self._recognizer.config
        self._recognizer = recognizer

    def configure(self, config: Config) -> None:
        """Go on with other settings."""
        self._recognizer.config = config

    def reset(self) -> None:
        """Forget the frames seen so far."""
        self._recognizer.reset()

    @property
    def clock_jumps(self) -> int:
        """How often the clock jumped back since the map was loaded."""
        return self._recognizer.resets

    def _answer(self, arrival: Arrival) -> None:
        start_ns = time.perf_counter_ns()
        frame = self._decode(arrival)
        match = self._recognizer.process(frame)
        duration_ms = (time.perf_counter_ns() - start_ns) / 1e6
        match = replace(match, query_index=self._frames)
        self._frames += 1
        self._results.write(match, duration_ms)
        self._publish(frame, match, self._recognizer)
        self._statistics.answered(match, arrival.arrival_ns, duration_ms)

    def _decode(self, arrival: Arrival) -> Frame:
        message, stamp_ns, topic = arrival.message, arrival.stamp_ns, arrival.topic
        decode = decode_compressed if isinstance(message, CompressedImage) else decode_image
        try:
            return Frame(stamp_ns, decode(message), topic)
        except ImageError as error:
            self._statistics.unreadable += 1
            self._logger.warning(f'{topic}: {error}', throttle_duration_sec=_LOG_PERIOD_S)
            return Frame(stamp_ns, None, topic, problem=str(error))
