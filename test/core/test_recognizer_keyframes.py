# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Queries are as far apart as the places of the map that they are matched with."""

from dataclasses import replace

from convseq_ros.config import (
    EncodingConfig,
    EVERY_FRAME,
    KeyframeConfig,
    make_config,
    OnlineConfig,
)
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.map.place import pack_cells, Place
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.types import Frame, Pose, Reason, Status
import numpy as np
import pytest

STEP_NS = 100_000_000
PLACES = 90
SMALL = EncodingConfig(image_size_px=256)
BY_TIME = KeyframeConfig(keyframe_interval_s=0.3)
BY_WAY = KeyframeConfig(keyframe_distance_m=2.5)
OWN = make_config(
    {'image_size_px': 256, 'matching': 'coherent', 'search': 'shortlist', 'fixed_length': 4}
)
ONLINE = replace(OWN, online=OnlineConfig(mode='online', exclusion_s=1.0), keyframes=BY_TIME)


@pytest.fixture(scope='module')
def third_places(image):
    """Return the packed cells of every third place."""
    return [pack_cells(describe(image(place), SMALL).cells) for place in range(0, PLACES, 3)]


def map_of(third_places, keyframes):
    made = ReferenceMap(SMALL, keyframes=keyframes)
    for index, packed in enumerate(third_places):
        made.add(Place(index), packed)
    return made


def at(place):
    return Pose((float(place), 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def show(recognizer, image, places, *, step_ns=STEP_NS, start_ns=0, odometry=False):
    """Return the answers to a drive, shown a little differently than in the map."""
    return [
        recognizer.process(
            Frame(
                start_ns + index * step_ns, image(place, 1), pose=at(place) if odometry else None
            )
        )
        for index, place in enumerate(places)
    ]


def test_a_map_of_keyframes_decides_which_frames_are_matched(third_places, image):
    recognizer = PlaceRecognizer(map_of(third_places, BY_TIME), OWN)
    matches = show(recognizer, image, range(30, 84))
    asked, between = matches[::3], [*matches[1::3], *matches[2::3]]
    assert {match.reason for match in between} == {Reason.BETWEEN_KEYFRAMES}
    assert {match.status for match in between} <= {Status.SKIPPED, Status.REJECTED}
    assert {match.pairs_scored for match in between} == {0}
    assert [match.best.reference_index for match in asked[3:]] == [*range(13, 28)]
    assert all(match.accepted for match in asked[12:])


def test_by_odometry_the_velocity_of_the_query_does_not_matter(third_places, image):
    recognizer = PlaceRecognizer(map_of(third_places, BY_WAY), OWN)
    slowly = np.repeat(np.arange(30, 48), 2).tolist()
    places = [*slowly, *range(48, 60), *range(60, 88, 3)]
    matches = show(recognizer, image, places, odometry=True)
    asked = [match for match in matches if match.reason is not Reason.BETWEEN_KEYFRAMES]
    assert [match.best.reference_index for match in asked[4:]] == [*range(14, 30)]
    assert all(match.accepted for match in asked[-6:])


def test_a_growing_map_holds_keyframes_and_recognises_them(image):
    grown = ReferenceMap(SMALL, keyframes=BY_TIME)
    lap = (
        150  # of which 50 are places; of 30, too few would be other places than one and its looks
    )
    matches = show(PlaceRecognizer(grown, ONLINE), image, [*range(lap)] * 2)
    stamps_ns = range(0, 2 * lap * STEP_NS, 3 * STEP_NS)
    assert [place.stamp_ns for place in grown.places] == [*stamps_ns]
    second = matches[lap + 9 :: 3]
    assert [match.accepted.reference_index for match in second] == [*range(3, 50)]
    assert [*grown.links][-47:] == [(50 + index, index) for index in range(3, 50)]


def test_after_a_clock_jump_the_first_frame_is_a_keyframe_and_was_looked_at(image):
    grown = ReferenceMap(SMALL, keyframes=BY_WAY)
    config = replace(ONLINE, keyframes=BY_WAY)
    recognizer = PlaceRecognizer(grown, config)
    show(recognizer, image, range(7), start_ns=10**12, odometry=True)
    show(recognizer, image, range(6, 12), odometry=True)
    assert recognizer.resets == 1 and recognizer.mapping.session_start == 3
    assert [int(place.pose.position[0]) for place in grown.places] == [0, 3, 6, 6, 9]
    assert all(grown.cells(index).any() for index in range(5))


def test_a_stop_and_dropped_frames_leave_the_keyframes_in_step(third_places, image):
    """Keyframes are 300 ms apart: two fall into a stop, and one is dropped."""
    recognizer = PlaceRecognizer(map_of(third_places, BY_TIME), OWN)
    places = [*range(15, 51), *[50] * 6, *range(51, 84)]
    matches = [
        recognizer.process(Frame(index * STEP_NS, image(place, 1)))
        for index, place in enumerate(places)
        if not 60 <= index < 63
    ]
    assert Reason.STATIONARY in {match.reason for match in matches}
    last = [match for match in matches if match.reason is not Reason.BETWEEN_KEYFRAMES][-5:]
    shown = [places[match.query_stamp_ns // STEP_NS] for match in last]
    assert [3 * match.best.reference_index for match in last] == shown
    assert Reason.WARMING_UP not in {match.reason for match in matches[20:]}


@pytest.mark.parametrize('keyframes', [BY_TIME, KeyframeConfig(), EVERY_FRAME])
def test_an_unreadable_frame_has_no_candidates_wherever_it_comes(third_places, image, keyframes):
    recognizer = PlaceRecognizer(map_of(third_places, keyframes), OWN)
    known = show(recognizer, image, range(30, 61))
    assert known[-1].candidates
    stamps_ns = [(31 + index) * STEP_NS for index in range(8)]
    lost = [recognizer.process(Frame(stamp_ns, None, problem='cut')) for stamp_ns in stamps_ns]
    assert {(match.status, match.reason) for match in lost} == {
        (Status.SKIPPED, Reason.UNREADABLE)
    }
    assert not any(match.candidates or match.confidence for match in lost)
