# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The node's counters and state, on /diagnostics."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
import time

from convseq_ros.app.pipeline import Pipeline
from convseq_ros.node.conversions import status_message
from convseq_ros.node.outputs.counters import Counters
from convseq_ros.node.qos import advertise, steady_timer
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node


@dataclass(frozen=True, slots=True)
class Situation:
    """What others are told of the node, besides its counters."""

    ready: bool  # False while it warms up
    enabled: bool  # False if frames are ignored on purpose
    pipeline: Pipeline  # the map in use and its file
    topic: str  # of the camera
    dropped: int  # frames pushed out of the queue
    odometry_comes: bool
    silences: Callable[[], Mapping[str, str]]  # why nothing comes on a topic; empty if it does
    further: Mapping[str, int | bool | float]  # other values on /diagnostics, by name
    transform_problem: str = ''  # why map -> odom is not broadcast, although it is wanted
    model_problem: str = ''  # why the map's descriptor_model is not used, if it failed
    stamp_problem: str = ''  # of the images

    @property
    def map_size(self) -> int:
        return len(self.pipeline.recognizer.reference_map)


@dataclass(eq=False)
class Diagnostics:
    """Publishes a status periodically, independent of the node's clock."""

    node: Node
    counters: Counters
    situation: Callable[[], Situation]  # returns the node's state
    period_s: float

    def __post_init__(self) -> None:
        self._last = (time.monotonic_ns(), 0, 0, 0)
        self._write_failures, self._told = 0, set[str]()
        self._publisher = advertise(self.node, DiagnosticArray, '/diagnostics')
        self._timer = steady_timer(self.node, self.period_s, self._publish)

    def configure(self, period_s: float) -> None:
        """Publish with another period from now on."""
        self._timer.timer_period_ns = round(period_s * 1e9)

    def _publish(self) -> None:
        situation = self.situation()
        received_hz, processed_hz, dropped_now = self._rates(situation)
        level, text = self._state(situation, dropped_now)
        values = _values(self.counters, situation)
        values |= {'received_hz': received_hz, 'processed_hz': processed_hz}
        name = f'{self.node.get_fully_qualified_name().lstrip("/")}: place recognition'
        message = DiagnosticArray(
            status=[status_message(level, name, text, values, situation.topic)]
        )
        message.header.stamp = self.node.get_clock().now().to_msg()
        self._publisher.publish(message)

    def _rates(self, situation: Situation) -> tuple[float, float, int]:
        now_ns = time.monotonic_ns()
        counts = self.counters.received, self.counters.processed, situation.dropped
        then_ns, *before = self._last
        received, processed, dropped = (new - old for new, old in zip(counts, before, strict=True))
        self._last = (now_ns, *counts)
        elapsed_s = max(now_ns - then_ns, 1) / 1e9
        return received / elapsed_s, processed / elapsed_s, dropped

    def _state(self, situation: Situation, dropped_now: int) -> tuple[bytes, str]:
        if not situation.ready:
            return DiagnosticStatus.OK, 'warming up'
        silences = [
            self._told_once(topic, silence if situation.enabled else '')
            for topic, silence in situation.silences().items()
        ]
        if not situation.map_size and not situation.pipeline.is_growing:
            return DiagnosticStatus.ERROR, (
                f'no map; call {self.node.get_fully_qualified_name()}/load_map or set map_path'
            )
        if not situation.enabled:
            return DiagnosticStatus.OK, 'disabled'
        if situation.pipeline.owner.lost:
            return DiagnosticStatus.ERROR, situation.pipeline.owner.lost
        if self._is_failing(situation):
            return DiagnosticStatus.ERROR, (
                f'{situation.pipeline.path}: new places cannot be written; see the log'
            )
        if silence := '; '.join(filter(None, silences)):
            return DiagnosticStatus.WARN, silence
        if self._has_twin():
            return DiagnosticStatus.WARN, (
                f'another node is named {self.node.get_fully_qualified_name()}; end it, or '
                'rename one: -r __node:=NAME'
            )
        if situation.transform_problem:
            return DiagnosticStatus.ERROR, situation.transform_problem
        for problem in (situation.model_problem, situation.stamp_problem):
            if problem:
                return DiagnosticStatus.WARN, problem
        if dropped_now:
            model_ms = situation.pipeline.recognizer.first_stage.duration_ms
            by_model = f', of which the model takes {model_ms:.0f} ms' if model_ms else ''
            return DiagnosticStatus.WARN, (
                f'{dropped_now} frames dropped: they come faster than they are processed'
                f'{by_model}; have fewer sent, or a map of keyframes (keyframe_interval_s)'
            )
        if problem := situation.pipeline.recognizer.reference_map.unreadable_why:
            return DiagnosticStatus.WARN, f'{problem}; its poses are less exact'
        if situation.pipeline.keyframes_m and not situation.odometry_comes:
            return DiagnosticStatus.WARN, (
                f'the map has a place every {situation.pipeline.keyframes_m:g} m, but there is no '
                'odometry to match frames as often; remap it: -r odom:=TOPIC'
            )
        if situation.pipeline.is_growing:
            return DiagnosticStatus.OK, 'recognising places and adding to them'
        return DiagnosticStatus.OK, 'recognising places'

    def _has_twin(self) -> bool:
        names = self.node.get_node_names_and_namespaces()
        return names.count((self.node.get_name(), self.node.get_namespace())) > 1

    def _is_failing(self, situation: Situation) -> bool:
        """Return whether new places cannot be written to this map, or to the one before it."""
        before, self._write_failures = self._write_failures, self.counters.write_failures
        return self._write_failures > before or situation.pipeline.owner.is_failing

    def _told_once(self, name: str, problem: str) -> str:
        """Return the problem of a stream, and log it when that begins."""
        if problem and name not in self._told:
            self.node.get_logger().warning(problem)
            self._told.add(name)
        elif not problem:
            self._told.discard(name)
        return problem


def _values(counters: Counters, situation: Situation) -> dict[str, object]:
    match, pipeline = counters.last_match, situation.pipeline
    localization = pipeline.cameras.localization
    state = 'enabled' if situation.enabled else 'disabled'
    values: dict[str, object] = {
        'state': state if situation.ready else 'warming_up',
        'mode': pipeline.recognizer.config.online.mode,
        'topic': situation.topic,
        'received': counters.received,
        'processed': counters.processed,
        'dropped': situation.dropped,
        'unreadable': counters.unreadable,
        'failed': counters.failed,
        'latency_ms': counters.latency_ms,
        'duration_ms': counters.duration_ms,
        'kernel': pipeline.kernel,
        'model': pipeline.recognizer.reference_map.encoding.descriptor_model,
        'model_ms': pipeline.recognizer.first_stage.duration_ms,
        'last_reason': match.reason.value if match else '',
        'last_sequence_length': match.sequence_length if match else 0,
        'last_score': match.best.score if match and match.best else 0.0,
        'localization': localization.state.value,
        'localization_quality': '' if localization.quality is None else localization.quality,
        'map_path': pipeline.path or '',
        'map_size': situation.map_size,
        'kept_images_unreadable': pipeline.recognizer.reference_map.unreadable,
        'odom': situation.odometry_comes,
        **situation.further,
    }
    if pipeline.is_growing:
        values |= {
            'places_added': pipeline.added,
            'places_kept': pipeline.owner.committed,
            'map_write_failures': counters.write_failures,
        }
        if pipeline.owner.committed_s is not None:
            values['since_last_commit_s'] = time.monotonic() - pipeline.owner.committed_s
    # A copy, because the worker's thread changes the original.
    counts = counters.reasons.copy()
    return values | {f'reason_{reason}': counts[reason] for reason in sorted(counts)}
