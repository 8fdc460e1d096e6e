# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A drawn street by day and in the evening: switched on, and carried away."""

from dataclasses import replace

from convseq_ros.core.map_builder import build_map
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.types import LocalizationState, Pose
from convseq_ros.simulation.drive import draw, Drive
from convseq_ros.simulation.street import Street
import pytest

pytestmark = pytest.mark.once

SIZE = {'width_px': 160, 'height_px': 120}
LOCALISED = LocalizationState.LOCALISED


def drawn(street, **how):
    return [shot.frame for shot in draw(Street(150.0, street), Drive(**how, **SIZE))]


@pytest.fixture(scope='module')
def evening():
    how = {'light': 'evening', 'lane_offset_m': -0.5, 'seed': 4}
    return [drawn(5, start_m=start_m, num_frames=9, **how) for start_m in (4.4, 36.4)]


@pytest.fixture(scope='module')
def recognizer():
    return PlaceRecognizer(build_map(drawn(5, num_frames=50)))


def seen(recognizer, frames, odometry):
    """Return state and metres off after each frame, a tenth of a second apart."""
    told = []
    for number, (frame, pose) in enumerate(zip(frames, odometry, strict=True), 1):
        shown = replace(frame, stamp_ns=number * 10**8, pose=pose)
        known, off_m = recognizer.process(shown).localization, None
        if known.reference_index is not None:
            place = recognizer.reference_map.places[known.reference_index]
            off_m = abs(place.pose.position[0] - frame.pose.position[0])
        told.append((known.state, off_m))
    return told


@pytest.mark.parametrize('has_odometry', [True, False])
def test_carried_away_it_is_found_again_within_four_frames(recognizer, evening, has_odometry):
    recognizer.reset()
    frames = evening[0] + evening[1]
    # Odometry goes on from where the robot was lifted, and has an origin of its own.
    ways = [Pose((float(step), 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)) for step in range(len(frames))]
    told = seen(recognizer, frames, ways if has_odometry else [None] * len(frames))
    here, there = told[:9], told[9:]
    assert here[0][0] is not LOCALISED and (LOCALISED in [state for state, _ in here[:4]])
    assert there[-1][0] is LOCALISED
    right = [off_m for state, off_m in here + there[3:] if state is LOCALISED]
    assert len(right) >= 10 and max(right) <= 3.0


def test_outside_the_map_it_is_never_localised(recognizer):
    recognizer.reset()
    elsewhere = drawn(77, start_m=20.4, num_frames=10, light='evening', seed=6)
    told = seen(recognizer, elsewhere, [None] * 10)
    assert LOCALISED not in [state for state, _ in told]
