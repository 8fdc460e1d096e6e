# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which places of the running drive may be matched: by scenes passed, not by clock or spacing."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from convseq_ros import Frame, PlaceRecognizer
from convseq_ros.config import EncodingConfig, make_config, with_values
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.gate.gate import FrameGate
from convseq_ros.core.map.online import Scenes
from convseq_ros.core.map.reference_map import ReferenceMap
import cv2
import numpy as np
from poses import at
import pytest

pytestmark = pytest.mark.once

SECOND = 10**9
WIDTH, HEIGHT, STEP = 160, 120, 16  # of an image in pixels; motion of the camera in pixels a metre
SMALL = EncodingConfig(image_size_px=128)
ONLINE = make_config({'image_size_px': 128, 'mode': 'online'})
SPACINGS = {
    'default': {},
    'every frame': {'keyframe_overlap': 1.0},
    'by distance': {'keyframe_distance_m': 3.0},
    'by time': {'keyframe_interval_s': 0.2},
}
# Metres from the start at each frame, and seconds between frames.
DRIVES = {
    'as it comes': (np.arange(0, 90, 1.0), 0.1),
    'creeping': (np.arange(0, 90, 0.5), 0.3),
    'stop and go': ([m for m in range(90) for _ in range(1 if m % 20 else 15)], 0.1),
    'a video at 60 Hz': (np.arange(0, 90, 0.5), 1 / 60),
    'a picture a minute': (np.arange(0, 180, 4.0), 60.0),
}


@pytest.fixture(scope='module')
def wall():
    """Return a picture of a long wall, coarse and fine, that shows nothing twice."""
    rng, width = np.random.default_rng(1), 3200
    coarse = [rng.random((HEIGHT // cell, width // cell), np.float32) for cell in (4, 8, 20)]
    layers = [cv2.resize(one, (width, HEIGHT)) for one in coarse]
    return cv2.normalize(sum(layers), None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


def along(wall: np.ndarray, metres_along: Sequence[float], step_s: float) -> list[Frame]:
    """Return what a camera sees that moves along a wall, with a little noise."""
    frames, rng = [], np.random.default_rng(2)
    for number, metres in enumerate(metres_along):
        left = round(metres * STEP)
        gray = np.take(wall, range(left, left + WIDTH), axis=1, mode='wrap')
        gray = np.clip(gray + rng.normal(0, 1, gray.shape), 0, 255).astype(np.uint8)
        stamp_ns = SECOND + round(number * step_s * SECOND)
        frames.append(Frame(stamp_ns, gray, pose=at(metres)))
    return frames


def driven(frames, config=ONLINE):
    """Drive online; return the recogniser, and the answers."""
    recognizer = PlaceRecognizer(ReferenceMap(SMALL, keyframes=config.keyframes), config)
    return recognizer, [recognizer.process(frame) for frame in frames]


@pytest.mark.parametrize('drive', DRIVES)
def test_keyframes_of_a_wall_are_scenes_and_as_many_however_it_is_passed(wall, drive):
    gate, scenes, keyframes = FrameGate(ONLINE, ONLINE.keyframes), Scenes(), 0
    for frame in along(wall, *DRIVES[drive]):
        describing = partial(describe, frame.gray, SMALL)
        verdict = gate.check(frame.stamp_ns, frame.pose, describing, frame.gray)
        if verdict.reason is None:
            scenes.count(verdict.edges)
            keyframes += 1
    assert 35 <= scenes.passed == keyframes <= 50


@pytest.mark.parametrize(
    ('drive', 'spacing'),
    [(drive, 'default') for drive in DRIVES]
    + [('as it comes', spacing) for spacing in SPACINGS if spacing != 'default']
    + [('stop and go', 'every frame')],
)
def test_a_drive_that_never_returns_matches_nothing(wall, drive, spacing):
    frames = along(wall, *DRIVES[drive])
    recognizer, matches = driven(frames, with_values(ONLINE, SPACINGS[spacing]))
    assert recognizer.mapping.usable >= 5  # there was something to match
    assert not [match.query_index for match in matches if match.accepted]


def test_a_clock_that_jumps_back_makes_no_place_old_enough(wall):
    first = along(wall, range(40), 0.1)
    later = along(wall, range(80), 0.1)[40:]
    jumped = [replace(one, stamp_ns=one.stamp_ns - 6 * SECOND) for one in later]
    recognizer, matches = driven([*first, *jumped])
    assert recognizer.resets == 1 and len(recognizer.reference_map.sessions) == 2
    assert 0 < recognizer.mapping.usable < len(recognizer.reference_map) - 18
    assert not any(match.accepted for match in matches)


@pytest.mark.parametrize(('paused_s', 'recent'), [(3, 20), (29, 20), (31, 0), (86_400, 0)])
def test_a_recogniser_started_again_does_not_match_what_it_saw_before(wall, paused_s, recent):
    frames, cut = along(wall, range(110), 0.1), 60
    killed, _ = driven(frames[:cut])
    places = len(killed.reference_map)
    again = PlaceRecognizer(killed.reference_map, ONLINE)
    later = [replace(one, stamp_ns=one.stamp_ns + paused_s * SECOND) for one in frames[cut:]]
    matches = [again.process(later[0])]
    assert again.mapping.usable == places - recent
    assert again.mapping.drive_start == (0 if recent else places)
    matches += map(again.process, later[1:])
    assert again.mapping.session_start == places and len(killed.reference_map.sessions) == 2
    assert again.mapping.usable >= places  # they get old as the drive goes on
    assert not recent or not any(match.accepted for match in matches)


@pytest.mark.parametrize('lap_s', [5.0, 18_000.0])
def test_a_full_turn_on_the_spot_is_a_return_however_long_it_takes(wall, lap_s):
    panorama = wall[:, :1280]  # 80 steps of 16 px
    turns = [Frame(one.stamp_ns, one.gray) for one in along(panorama, range(200), lap_s / 80)]
    _, matches = driven(turns)
    assert not any(match.accepted for match in matches[:70])  # before the start is in view
    found = [match for match in matches[100:] if match.accepted]
    assert len(found) > 20
    for match in found:
        turned = (match.query_stamp_ns - match.accepted.reference_stamp_ns) / SECOND / lap_s * 80
        assert min(turned % 80, -turned % 80) <= 5


def test_the_way_back_over_the_same_view_is_a_return(wall):
    there = [*range(0, 100, 2)]
    frames = along(wall, [*there, *there[::-1]], 1.0)
    _, matches = driven(frames)
    found = [match for match in matches if match.accepted]
    assert len(found) > 10 and min(match.query_index for match in found) > len(there)
    for match in found:
        place = round((match.accepted.reference_stamp_ns - SECOND) / SECOND)
        assert abs(place - (2 * len(there) - 1 - match.query_index)) <= 3
