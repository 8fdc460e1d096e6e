# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The cost of a frame that is not a keyframe: by time, by odometry, by image content."""

import time

from convseq_ros.config import Config, KeyframeConfig
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.types import Frame, Pose, Reason
import numpy as np

from bench.finding import Finding
from bench.material import Work

_RATE_HZ, _FRAMES = 30, 150
_MOST_MS = 0.3
_AHEAD = (0.0, 0.0, 0.0, 1.0)
BY_SCENE = 'by scene, no odometry'
# The keyframe rule, whether there is odometry, and the speed in m/s.
_SETUPS = {
    'by time': (KeyframeConfig(keyframe_interval_s=0.125), False, 10.0),
    'by odometry': (KeyframeConfig(keyframe_distance_m=1.25), True, 10.0),
    'by scene, odometry says that it moves': (KeyframeConfig(), True, 1.0),
    BY_SCENE: (KeyframeConfig(), False, 1.0),
}


def measure(work: Work) -> list[Finding]:
    """Measure frames between keyframes."""
    return [_measured(work, name, *setup) for name, setup in _SETUPS.items()]


def _measured(
    work: Work, name: str, keyframes: KeyframeConfig, has_odometry: bool, speed_mps: float
) -> Finding:
    images = work.images_of(12 if work.quick else _FRAMES, speed_mps)
    reference_map = open_map(work.map_path(work.sizes[0]))
    reference_map.keyframes = keyframes
    recognizer = PlaceRecognizer(reference_map, Config())
    took_ms = []
    for index, gray in enumerate(images):
        pose = Pose((speed_mps * index / _RATE_HZ, 0.0, 0.0), _AHEAD) if has_odometry else None
        frame = Frame(round(index * 1e9 / _RATE_HZ), gray, pose=pose)
        start_ns = time.process_time_ns()
        reason = recognizer.process(frame).reason
        spent_ms = (time.process_time_ns() - start_ns) / 1e6
        if reason in (Reason.BETWEEN_KEYFRAMES, Reason.STATIONARY):
            took_ms.append(spent_ms)
    return Finding(
        what=f'frame between keyframes, {speed_mps:g} m/s, {_RATE_HZ} Hz',
        side=name,
        value=float(np.median(took_ms)) if took_ms else None,
        runs=len(took_ms),
        most=_MOST_MS,
        note=f'{len(took_ms)} of {len(images)} frames',
    )
