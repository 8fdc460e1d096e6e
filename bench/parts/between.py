# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a frame costs that is no keyframe: by time, by odometry, by what it shows."""

from dataclasses import dataclass
import time

from convseq_ros.config import Config, KeyframeConfig
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.frame_gate import FrameGate
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.similarity.paper_similarity import PaperSimilarity
from convseq_ros.core.types import Frame, Pose, Reason
import numpy as np
import numpy.typing as npt

from bench.clock import Times
from bench.finding import at_least, at_most, Finding
from bench.material import read_drive
from bench.work import Work

_RATE_HZ, _FRAMES = 30, 150
_MOST_MS, _LEAST_SAME = 0.3, 0.99
_AHEAD = (0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True)
class _Way:
    """How keyframes are told, and the drive."""

    name: str
    keyframes: KeyframeConfig
    has_odometry: bool
    speed_mps: float


_BY_SCENE = KeyframeConfig()
_WAYS = (
    _Way('by time', KeyframeConfig(keyframe_interval_s=0.125), False, 10.0),
    _Way('by odometry', KeyframeConfig(keyframe_distance_m=1.25), True, 10.0),
    _Way('by scene, odometry says that it moves', _BY_SCENE, True, 1.0),
    _Way('by scene, no odometry', _BY_SCENE, False, 1.0),
)


def measure(work: Work) -> list[Finding]:
    """Drive past a recogniser, and past the gate alone without glances, for the same decisions."""
    return [_measured(work, way) for way in _WAYS]


def _measured(work: Work, way: _Way) -> Finding:
    images = read_drive(work.folder, 12 if work.quick else _FRAMES, way.speed_mps)
    reference_map = open_map(work.map_path(work.sizes[0]))
    reference_map.keyframes = way.keyframes
    recognizer = PlaceRecognizer(reference_map, Config())
    gate = FrameGate(Config(), way.keyframes, PaperSimilarity())
    took_ms, same = [], []
    for index, gray in enumerate(images):
        frame = _frame(index, gray, way)
        start_ns = time.perf_counter_ns()
        reason = recognizer.process(frame).reason
        spent_ms = (time.perf_counter_ns() - start_ns) / 1e6
        verdict = gate.update(frame.stamp_ns, frame.pose, lambda gray=gray: describe(gray))
        passed = reason in (Reason.BETWEEN_KEYFRAMES, Reason.STATIONARY)
        same.append(passed == (verdict.reason is not None))
        took_ms += [spent_ms] * passed
    what = f'frame between keyframes, {way.speed_mps:g} m/s, {_RATE_HZ} Hz'
    note = (
        f'{len(took_ms)} of {len(images)} frames, mean {np.mean(took_ms or 0):.2g} ms; '
        f'{np.mean(same):.3f} decided as without glances'
    )
    finding = Finding(what=what, side=way.name, threads=work.threads, note=note)
    if not took_ms:
        return finding
    times = Times(tuple(took_ms))
    share = at_least(float(np.mean(same)), _LEAST_SAME, 'of the decisions')
    return finding.timed(times).aiming(at_most(times.median, _MOST_MS, 'ms'), share)


def _frame(index: int, gray: npt.NDArray[np.uint8], way: _Way) -> Frame:
    pose = Pose((way.speed_mps * index / _RATE_HZ, 0.0, 0.0), _AHEAD) if way.has_odometry else None
    return Frame(round(index * 1e9 / _RATE_HZ), gray, pose=pose)
