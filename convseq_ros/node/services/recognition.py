# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The work on one frame, done in the worker's thread: decode, recognise, record, publish."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
import time
from typing import Any

from convseq_ros.app.pipeline import Pipeline
from convseq_ros.core.types import Frame
from convseq_ros.errors import (
    ConvseqError,
    ImageError,
    MapError,
    ModelError,
    one_line,
    with_traceback,
)
from convseq_ros.node.inputs.frame_context import FrameContext
from convseq_ros.node.inputs.once import Once
from convseq_ros.node.outputs.counters import Counters
from convseq_ros.node.outputs.publishers import Answered
from convseq_ros.node.outputs.result_log import ResultLog
from convseq_ros.node.services.map_linking import MapLinking
from convseq_ros.sources.images import gray_of, message_pixels
from convseq_ros.sources.raw_message import RawMessage

_LOG_PERIOD_S = 5.0


@dataclass(frozen=True, slots=True)
class Arrival:
    """A message as it came in."""

    message: RawMessage
    stamp_ns: int  # when it was taken
    arrival_ns: int  # monotonic time at which it came
    topic: str
    number: int  # messages before it, including dropped ones


@dataclass(eq=False)
class Recognition:
    """Answers frames one after another; neither a broken frame nor a full disk stops it."""

    pipeline: Pipeline  # the current one
    context: FrameContext
    results: ResultLog  # gets a row for every answer
    publish: Callable[[Answered], None]
    counters: Counters
    logger: Any
    ros_is_up: Callable[[], bool]  # False when the node is about to end
    model_problem: str = ''  # why the map's model is not used, if it failed
    _linking: MapLinking | None = None

    def __post_init__(self) -> None:
        self._once = Once(self.logger)

    def handle(self, arrival: Arrival) -> None:
        """Answer a frame; an error is logged and counted."""
        with self._counting():
            self._answer(arrival, *self._read(arrival))

    @contextmanager
    def _counting(self) -> Iterator[None]:
        """Log and count an error."""
        try:
            yield
        except Exception as error:
            # Publishing fails while a signal shuts ROS down; the result row is written before.
            if isinstance(error, MapError):
                self.pipeline.owner.give_up(one_line(error))
            if isinstance(error, ConvseqError) or self.ros_is_up():
                self.counters.failed += 1
                self.logger.error(with_traceback(error), throttle_duration_sec=_LOG_PERIOD_S)

    def swap(self, pipeline: Pipeline) -> None:
        """Replace the pipeline, and so the map; additions of the old one are saved."""
        pipeline.cameras.configure(self.pipeline.cameras.config)
        self.close()
        self.pipeline, self.model_problem = pipeline, ''
        self.link()

    def link(self) -> None:
        """Link the map, if links are missing, while frames are answered."""
        self._linking = MapLinking(self.pipeline, self.logger)

    def close(self) -> None:
        if self._linking:
            self._linking.stop()
        try:
            self.pipeline.close()
        except (ConvseqError, OSError) as error:
            self.counters.write_failures += 1
            self.logger.error(one_line(error))

    def _read(self, arrival: Arrival) -> tuple[Frame, float]:
        """Return a frame with its pose, and the milliseconds that decoding took."""
        pose = self.context.odometry.pose_at(arrival.stamp_ns)
        start_ns = time.perf_counter_ns()
        frame = replace(self._decode(arrival), pose=pose)
        return frame, (time.perf_counter_ns() - start_ns) / 1e6

    def _answer(self, arrival: Arrival, frame: Frame, before_ms: float) -> None:
        cameras = self.pipeline.cameras
        start_ns = time.perf_counter_ns()
        try:
            match = cameras.process(frame)
        except ModelError as error:
            self._drop_model(error)
            cameras = self.pipeline.cameras
            match = cameras.process(frame)
        duration_ms = before_ms + (time.perf_counter_ns() - start_ns) / 1e6
        self._save()
        for line in cameras.notes:
            self._once.note(line)
        for problem in cameras.problems:
            self._once.warn(problem)
        match = replace(match, query_index=arrival.number)
        self.results.write(match, duration_ms)
        latency_ms = (time.monotonic_ns() - arrival.arrival_ns) / 1e6
        by = cameras.of(frame.source)
        start, model_ms = by.mapping.session_start, by.model_ms
        self.publish(Answered(frame, match, by, start, model_ms, duration_ms, latency_ms))
        self.counters.answered(match, arrival.arrival_ns, duration_ms)

    def _drop_model(self, error: ModelError) -> None:
        """Use the built-in descriptor, and stop growing the map; raise the error if impossible."""
        self.model_problem = f'{error}; nothing is recognised'
        pipeline, config = self.pipeline, self.pipeline.cameras.config
        if pipeline.path is None:
            raise error
        pipeline.flush()
        encoding = replace(config.encoding, descriptor_model='')
        online = replace(config.online, mode='preloaded')
        config = replace(config, encoding=encoding, online=online)
        sources = [*pipeline.cameras.recognizers]
        self.swap(Pipeline(pipeline.path, config, sources=sources))
        self.model_problem = f'{error}; the built-in descriptor is used, and the map does not grow'
        self.logger.error(self.model_problem)

    def _save(self) -> None:
        """Write new places to the map's file; log and count a failure."""
        try:
            self.pipeline.save()
        except (ConvseqError, OSError) as error:
            self.counters.write_failures += 1
            self.logger.error(one_line(error), throttle_duration_sec=_LOG_PERIOD_S)

    def _decode(self, arrival: Arrival) -> Frame:
        stamp_ns, topic = arrival.stamp_ns, arrival.topic
        reading = self.pipeline.recognizer.config.reading
        try:
            gray = gray_of(message_pixels(arrival.message, reading))
        except ImageError as error:
            self.counters.unreadable += 1
            self._once.warn(f'{topic}: {one_line(error)}')
            return Frame(stamp_ns, None, topic, problem=str(error))
        camera = self.context.camera_for(topic, *gray.shape)
        frame_id = arrival.message.frame_id
        return Frame(stamp_ns, gray, topic, camera=camera, frame_id=frame_id)
