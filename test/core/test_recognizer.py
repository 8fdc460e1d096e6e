# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The whole pipeline on drawn images."""

from convseq_ros.config import Config, EVERY_FRAME, make_config, with_values
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.map.place import pack_cells, Place
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.types import Frame, Reason, Status
import numpy as np
import pytest

STEP_NS = 100_000_000
PLACES = 50
PAPER = make_config({'matching': 'regional', 'search': 'exhaustive'})
FIXED = with_values(PAPER, {'fixed_length': 3})


def image(place):
    rng = np.random.default_rng(place)
    return np.kron(rng.integers(0, 256, (16, 20)), np.ones((6, 6))).astype(np.uint8) // 2 + (
        rng.integers(0, 128, (96, 120), np.uint8)
    )


@pytest.fixture(scope='module')
def reference_map():
    made = ReferenceMap(keyframes=EVERY_FRAME)
    for place in range(PLACES):
        made.add(Place(5000 + place), pack_cells(describe(image(place)).cells))
    return made


def run(recognizer, images, start_ns=0):
    return [
        recognizer.process(Frame(start_ns + index * STEP_NS, each))
        for index, each in enumerate(images)
    ]


def test_a_drive_along_the_map_is_recognised_frame_by_frame(reference_map):
    matches = run(PlaceRecognizer(reference_map, PAPER), [image(place) for place in range(5, 35)])
    matched = [match for match in matches if match.reason is not Reason.WARMING_UP]
    assert matches[0].reason is Reason.WARMING_UP and len(matched) > 5
    for match in matched:
        assert match.status is Status.ACCEPTED
        assert match.accepted.reference_index == 5 + match.query_index
        assert match.accepted.reference_stamp_ns == 5005 + match.query_index
        assert match.pairs_scored == PLACES


def test_a_longer_fixed_length_set_while_running_waits_for_its_frames(reference_map):
    recognizer = PlaceRecognizer(reference_map, FIXED)
    run(recognizer, [image(place) for place in range(4)])
    recognizer.config = with_values(PAPER, {'fixed_length': 6})
    matches = run(recognizer, [image(place) for place in range(4, 8)], start_ns=4 * STEP_NS)
    assert [match.reason for match in matches][:2] == [Reason.WARMING_UP] * 2
    assert matches[-1].accepted.reference_index == 7


def test_a_map_that_shows_nothing_answers_without_a_match():
    noise = np.random.default_rng(0).integers(0, 256, (64, 64), np.uint8)
    black = ReferenceMap()
    for index in range(3):
        dark = np.zeros((64, 64), np.uint8)
        black.add_frame(Frame(index + 1, dark), describe(dark), 0)
    match = PlaceRecognizer(black, Config()).process(Frame(10**9, noise))
    assert match.accepted is None
