# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which share of a place's scene other places show, and what has been in view ever since."""

from dataclasses import replace
import sqlite3

from convseq_ros import build_map, Frame, open_map, PlaceRecognizer
from convseq_ros.app.cameras import Cameras
from convseq_ros.config import make_config, with_values
from convseq_ros.core.decision.covisibility import Covisibility
from convseq_ros.core.types import Camera, Reason
import cv2
import numpy as np
from pictures import corners
import pytest

pytestmark = pytest.mark.once

OF_SIZE = make_config({'image_size_px': 256, 'keyframe_overlap': 1.0, 'threads': 1})
CONFIG = with_values(OF_SIZE, {'stationary_glance': 0.0})
ONLINE = with_values(CONFIG, {'mode': 'online'})
WIDE, HIGH = 320, 240
FISHEYE = Camera(WIDE, HIGH, 160.0, 160.0, 159.5, 119.5, 'equidistant', (0.01, 0.0, 0.0, 0.0))
LEFT_HALF = '#' + 'ff00' * 16  # of 16 x 16 cells


def panorama(number):
    return corners(number, (2000, HIGH))


def panned(number, start, step, count):
    """Return images of a camera that pans over a panorama, from column `start` on."""
    whole = panorama(number)
    return [whole[:, start + step * at :][:, :WIDE] for at in range(count)]


def shown(images, camera=None):
    return [Frame(at * 10**8, one, camera=camera) for at, one in enumerate(images)]


def noisy(images, camera=None):
    """Return frames of images that were taken again, later."""
    rng = np.random.default_rng(0)
    again = [(one + rng.normal(0, 6, one.shape)).clip(0, 255).astype(np.uint8) for one in images]
    return shown(again, camera)


def covisibility_of(images, config=CONFIG):
    return PlaceRecognizer(build_map(shown(images), None, CONFIG), config).decider._covisibility


@pytest.fixture(scope='module')
def pans() -> Covisibility:
    """Return that of a drive that pans over one panorama and then over another."""
    return covisibility_of(panned(1, 0, 20, 20) + panned(2, 0, 20, 20))


def test_a_place_shows_the_scene_of_its_neighbours_and_less_and_less_of_others(pans):
    shares = pans.shares(8, np.arange(8, 20))
    assert shares[0] == 1 and shares[1] > 0.8
    # Eight places on, half of the image is in view; its keypoints are those on the other side.
    assert 0.2 < shares[8] < 0.6
    assert (np.diff(shares[2:]) < 0.1).all() and shares[2] > shares[6] > shares[10] > 0


def test_a_place_of_another_scene_shows_nothing(pans):
    assert pans.shares(8, np.arange(20, 40)).max() < 0.05


def test_without_keypoints_no_place_shows_another(pans):
    without = covisibility_of(panned(1, 0, 20, 12), with_values(CONFIG, {'keypoints': 0}))
    assert not without.shares(5, np.arange(12)).any()
    dark = covisibility_of([np.zeros((HIGH, WIDE), np.uint8)] * 12)
    assert not dark.shares(5, np.arange(12)).any() and not dark.is_in_view(0)


@pytest.mark.parametrize('count', [1, 2, 3])
def test_a_map_of_few_places_has_shares_and_no_match(count):
    views = panned(1, 0, 20, count)
    recognizer = PlaceRecognizer(build_map(shown(views), None, CONFIG), CONFIG)
    assert recognizer.decider._covisibility.shares(0, np.arange(count)).min() > 0.8
    matches = [recognizer.process(frame) for frame in noisy(views * 4)]
    assert {match.reason for match in matches} <= {Reason.TOO_FEW_RIVALS, Reason.WEAK}


def test_a_damaged_place_shows_no_other_and_those_beside_it_still_do(tmp_path):
    path = tmp_path / 'map.db'
    build_map(shown(panned(1, 0, 4, 10)), path, CONFIG)
    with sqlite3.connect(path) as database:
        database.execute('UPDATE pictures SET crc32 = crc32 + 1 WHERE reference_index = 5')
    database.close()
    covisibility = PlaceRecognizer(open_map(path), CONFIG).decider._covisibility
    assert covisibility.share(4, 6) > 0.7 and covisibility.share(4, 5) == 0
    assert covisibility.share(5, 4) == 0
    assert covisibility.is_in_view(0) and not covisibility.is_in_view(5)


@pytest.mark.parametrize(
    ('values', 'camera'),
    [
        ({'both_directions': True}, None),
        ({'image_rotation_deg': 90}, None),
        ({'image_mask': LEFT_HALF}, None),
        ({}, FISHEYE),
    ],
)
def test_whatever_the_camera_a_map_has_shares_and_answers_as_without_them(values, camera):
    config, views = with_values(CONFIG, values), panned(1, 0, 40, 30)
    known = build_map(shown(views, camera), None, config)
    back = [*range(9, 4, -1)] if values.get('both_directions') else [*range(5, 10)]
    frames = noisy([views[at] for at in back], camera)
    for has_shares in (True, False):
        recognizer = PlaceRecognizer(known, config)
        covisibility = recognizer.decider._covisibility
        if not has_shares:
            covisibility._blocks = lambda *_: 0.0
        assert (covisibility.share(8, 10) > 0.2) is has_shares
        found = [recognizer.process(frame).accepted for frame in frames]
        assert [one and one.reference_index for one in found] == back


@pytest.mark.parametrize('levels', [1, 4], ids=['black', 'noise'])
def test_a_drive_in_the_dark_matches_nothing(levels):
    known, rng = build_map(shown(panned(1, 0, 40, 30)), None, CONFIG), np.random.default_rng(0)
    recognizer = PlaceRecognizer(known, CONFIG)
    dark = [rng.integers(0, levels, (HIGH, WIDE), np.uint8) for _ in range(8)]
    assert not any(recognizer.process(frame).accepted for frame in shown(dark))


def test_the_scene_of_a_laps_end_is_shown_again_at_its_beginning():
    lap, among = panned(1, 0, 40, 30) + panned(1, 0, 40, 2), np.array([0, 1, 2, 15, 20])
    places, shares = covisibility_of(lap).shown(31, among)
    assert places.tolist() == [0, 1, 2] and shares[1] > 0.9 and shares.min() > 0
    without = with_values(CONFIG, {'keypoints': 0})
    places, shares = covisibility_of(lap, without).shown(31, among)
    assert len(places) == len(shares) == 0


def test_a_robot_that_passes_the_seam_of_a_lap_is_expected_at_its_beginning():
    ring = np.hstack([panorama(1), panorama(1)[:, :WIDE]])
    views = [ring[:, start : start + WIDE] for start in range(0, 2000, 40)]
    recognizer = PlaceRecognizer(build_map(shown(views), None, CONFIG), CONFIG)
    for frame in noisy(views[40:]):
        assert recognizer.process(frame).accepted
    belief = recognizer.decider._belief
    belief.predict(len(views), len(views))
    assert belief.mass[belief.places < 4].sum() > 0.3


def test_a_view_that_pans_slowly_is_in_view_all_along(pans):
    slow = covisibility_of(panned(1, 0, 4, 40))
    assert slow.is_in_view(0)
    # With the second panorama before them, places of the first are long out of view.
    assert not pans.is_in_view(8)


def test_a_scene_that_returns_after_others_was_not_in_view():
    back = covisibility_of(panned(1, 0, 4, 20) + panned(2, 0, 4, 12) + panned(1, 0, 4, 4))
    assert not back.is_in_view(2)
    short = covisibility_of(panned(1, 0, 4, 20) + panned(2, 0, 4, 3) + panned(1, 0, 4, 4))
    assert short.is_in_view(2)  # something passes before the camera


def test_a_true_return_to_the_end_of_a_map_that_grows_no_more_is_a_match():
    recognizer = PlaceRecognizer(build_map([], None, ONLINE), ONLINE)
    first, others = panned(1, 0, 40, 30), panned(2, 0, 40, 30)
    frames = noisy([*first, *others, *first[20:]])
    for frame in frames[:30]:
        recognizer.process(frame)
    recognizer.mapping.freeze()
    matches = [recognizer.process(frame) for frame in frames[30:]]
    assert not any(match.accepted for match in matches[:30])
    back = [match.reason for match in matches[30:]]
    assert Reason.RECENT not in back and back.count(Reason.ACCEPTED) >= 8


@pytest.mark.parametrize('sources', [('',), ('/front', '/rear')], ids=['one camera', 'two'])
def test_a_robot_that_stands_before_one_view_recognises_none_of_its_own_past(sources):
    """People pass, and lights flicker: the keyframes differ, and the scene behind stays."""
    rng, (view,) = np.random.default_rng(0), panned(3, 0, 0, 1)
    images = panned(4, 0, 40, 30)
    for at in range(80):
        light = view * (1 + 0.12 * np.sin(0.9 * at)) + rng.normal(0, 4, view.shape)
        image = light.clip(0, 255).astype(np.uint8)
        for person in range(3):
            x = (at * 37 + person * 131) % 420 - 50
            cv2.rectangle(image, (x, 90), (x + 45, HIGH), 60 + 60 * person, -1)
        images.append(image)
    grown = build_map([], None, ONLINE)
    cameras = Cameras(grown, ONLINE, sources)
    matches = [
        [cameras.process(replace(frame, source=one)) for one in sources] for frame in shown(images)
    ]
    assert len(grown) > 60
    for each in zip(*matches, strict=True):  # of a camera; all of them see the same
        assert Reason.RECENT in {match.reason for match in each[60:]}
        assert not any(match.accepted for match in each)
