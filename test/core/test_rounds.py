# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Drawn towns: driven round and round, switched on in the evening, and carried away."""

from dataclasses import replace
import math

from convseq_ros import build_map, Config, PlaceRecognizer
from convseq_ros.config import EncodingConfig, OnlineConfig
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import LocalizationState, Pose, Reason
from convseq_ros.simulation.drive import Drive
from convseq_ros.simulation.route import Route
from convseq_ros.simulation.street import Street
from drives import shots_of
import numpy as np
import pytest

pytestmark = pytest.mark.once

ROUTE = Route(((10.0, 0.0), (60.0, 0.0), (60.0, 40.0), (0.0, 40.0), (0.0, 0.0), (10.0, 0.0)), 3)

ROUND, SPEED_MPS, STEP_NS = 70, ROUTE.length_m / 7, 10**8  # frames, 10 Hz
ENCODING = EncodingConfig(image_size_px=256)
ONLINE = Config(encoding=ENCODING, online=OnlineConfig(mode='online'))
RIGHT_M = 5.0


@pytest.fixture(scope='module')
def one_round():
    drive = Drive(num_frames=ROUND, speed_mps=SPEED_MPS, width_px=160, height_px=120)
    return [shot.frame for shot in shots_of(ROUTE, drive)]


def rounds(frames, count):
    """Yield the frames of some rounds, each with other noise, a little turned, in other light."""
    rng = np.random.default_rng(0)
    for index in range(count * len(frames)):
        frame, turn = frames[index % len(frames)], index // len(frames)
        gray = np.roll(frame.gray, 3 * turn, axis=1) * (1 - 0.2 * turn)
        gray = np.clip(gray + rng.normal(0, 3, gray.shape), 0, 255).astype(np.uint8)
        yield replace(frame, gray=gray, stamp_ns=index * STEP_NS)


def driven(shots, config=ONLINE):
    """Return a map that grew, and how far each keyframe's match is off, None if there is none."""
    grown = ReferenceMap(ENCODING, keyframes=config.keyframes)
    recognizer, found = PlaceRecognizer(grown, config), []
    for index, (frame, truth) in enumerate(shots):
        match = recognizer.process(frame)
        if match.reason in (Reason.BETWEEN_KEYFRAMES, Reason.STATIONARY):
            continue
        best = match.accepted
        off_m = best and math.dist(shots[best.reference_stamp_ns // STEP_NS][1], truth)
        found.append((index, off_m))
    return grown, found


@pytest.mark.parametrize('with_odometry', [False, True])
def test_the_second_and_third_round_are_recognised_and_linked(one_round, with_odometry):
    shots = [(one, one.pose.position) for one in rounds(one_round, 3)]
    if not with_odometry:
        shots = [(replace(one, pose=None), truth) for one, truth in shots]
    grown, found = driven(shots)
    # The last frame of the first round sees its beginning.
    assert not [index for index, off_m in found if off_m is not None and index < ROUND - 1]
    assert max(off_m for _, off_m in found if off_m is not None) <= RIGHT_M
    # In the first frames of the second round there are few places to compare with.
    later = [off_m is not None for index, off_m in found if index >= ROUND + 15]
    assert sum(later) >= 0.95 * len(later) > ROUND
    where = [shots[place.stamp_ns // STEP_NS][1] for place in grown.places]
    linked = [math.dist(where[place], where[anchor]) for place, anchor in grown.links]
    assert len(linked) > 0.55 * len(grown) and max(linked) <= 2 * RIGHT_M
    assert all(one.confidence > 0.9 and one.inliers for one in grown.links.each())
    # Neighbours of its own drive give the scale, where odometry says how far apart they are.
    in_metres = [one for one in grown.links.each() if one.relative and one.relative.pose]
    assert len(in_metres) > 0.5 * len(linked) if with_odometry else not in_metres


def test_links_in_cool_down_keep_their_transform_and_are_held_back(one_round):
    seldom = replace(ONLINE, acceptance=replace(ONLINE.acceptance, closure_interval_s=1.0))
    shots = []
    for one in rounds(one_round, 2):
        pose = replace(one.pose, variances=(0.01, 0.01))
        shots.append((replace(one, pose=pose), pose.position))
    always, told = (driven(shots, config)[0] for config in (ONLINE, seldom))
    assert sum(bool(one.relative) for one in told.links.each()) > 20
    assert [*map(link_facts, always.links.each())] == [*map(link_facts, told.links.each())]
    trail = told.trail.since(0)
    assert 3 < sum(bool(one.other) for one in trail) <= 8
    told_at = {one.stamp_ns for one in trail if one.other}
    linked_at = {told.places[one.place].stamp_ns for one in told.links.each() if one.relative}
    assert {one.stamp_ns for one in trail if one.is_held_back} == linked_at - told_at
    assert not any(one.is_held_back for one in always.trail.since(0))


def link_facts(one):
    return one.place, one.other, one.relative and one.relative.position_m


SIZE = {'width_px': 160, 'height_px': 120}
LOCALISED = LocalizationState.LOCALISED


def drawn(street, **how):
    return [shot.frame for shot in shots_of(Street(150.0, street), Drive(**how, **SIZE))]


@pytest.fixture(scope='module')
def recognizer():
    return PlaceRecognizer(build_map(drawn(5, num_frames=50)))


def states(recognizer, frames, odometry):
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
def test_a_robot_that_was_carried_away_is_localised_within_four_frames(recognizer, has_odometry):
    recognizer.reset()
    how = {'light': 'evening', 'lane_offset_m': -0.5, 'seed': 4, 'num_frames': 9}
    frames = drawn(5, start_m=4.4, **how) + drawn(5, start_m=36.4, **how)
    # Odometry goes on from where the robot was lifted, and has an origin of its own.
    poses = [Pose((float(step), 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)) for step in range(len(frames))]
    told = states(recognizer, frames, poses if has_odometry else [None] * len(frames))
    here, there = told[:9], told[9:]
    assert LOCALISED in [state for state, _ in here[:4]]
    assert there[-1][0] is LOCALISED
    right = [off_m for state, off_m in here + there[3:] if state is LOCALISED]
    assert len(right) >= 10 and max(right) <= 3.0


def test_a_robot_outside_the_map_is_never_localised(recognizer):
    recognizer.reset()
    elsewhere = drawn(77, start_m=20.4, num_frames=10, light='evening', seed=6)
    told = states(recognizer, elsewhere, [None] * 10)
    assert LOCALISED not in [state for state, _ in told]
