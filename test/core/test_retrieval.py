# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The shortlist."""

from convseq_ros.config import Config, MatchingConfig, SequenceConfig
from convseq_ros.core.descriptor import describe
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.reference_map import pack_cells, Place, ReferenceMap
from convseq_ros.core.retrieval import pooled, Shortlist
from convseq_ros.core.types import Frame
import cv2
import numpy as np
import pytest

PLACES = 80


def image(place, seed=0):
    rng = np.random.default_rng(place)
    coarse = cv2.resize(rng.random((20, 20)).astype(np.float32), (160, 120))
    return ((coarse + np.random.default_rng([place, seed]).random((120, 160)) / 2) * 150).astype(
        np.uint8
    )


@pytest.fixture(scope='module')
def reference_map():
    made = ReferenceMap()
    for place in range(PLACES):
        made.add(Place(place), pack_cells(describe(image(place)).cells))
    return made


def run(reference_map, search, places, **more):
    config = Config(
        matching=MatchingConfig(matching='coherent', search=search, **more),
        sequence=SequenceConfig(fixed_length=5),
    )
    recognizer = PlaceRecognizer(reference_map, config)
    return [
        recognizer.process(Frame(index, image(place, seed=1)))
        for index, place in enumerate(places)
    ]


def test_pooling_takes_the_mean_over_each_part_of_the_image():
    cells = describe(image(0)).cells
    found = pooled(cells)
    assert found.shape == (2048,) and found.dtype == np.float32
    from convseq_ros.core.matching.coherent import projected_regions

    regions = projected_regions(cells).reshape(30, 30, 32)
    assert found[:32] == pytest.approx(regions[:3, :3].mean(axis=(0, 1)), abs=1e-6)
    assert found[-32:] == pytest.approx(regions[26:, 26:].mean(axis=(0, 1)), abs=1e-6)


def test_the_shortlist_finds_what_exhaustive_search_finds_with_fewer_pairs(reference_map):
    places = range(20, 40)
    listed = run(reference_map, 'shortlist', places, shortlist_length=12)
    scored = run(reference_map, 'exhaustive', places)
    for place, short, whole in list(zip(places, listed, scored, strict=True))[4:]:
        assert short.best.reference_index == whole.best.reference_index == place
        assert short.best.score == pytest.approx(whole.best.score)
        assert short.best.shift == whole.best.shift
    later = [match.pairs_scored for match in listed[8:]]
    assert max(later) < 12 * 5 and np.mean(later) < PLACES
    assert all(match.pairs_scored == PLACES for match in scored)


def test_rivals_are_on_the_shortlist(reference_map):
    listed = run(reference_map, 'shortlist', range(30, 45), shortlist_length=12)
    assert all(len(match.candidates) > 1 for match in listed[4:])


def test_ends_lie_where_the_window_fits_and_are_ascending(reference_map):
    shortlist = Shortlist(reference_map, 12, 10)
    rows = [shortlist.row(describe(image(place))) for place in (5, 6, 7)]
    ends = shortlist.ends(rows[::-1])
    assert 7 in ends and ends.min() >= 2 and (np.diff(ends) > 0).all() and len(ends) <= 12


def test_a_short_map_is_listed_whole():
    small = ReferenceMap()
    for place in range(4):
        small.add(Place(place), pack_cells(describe(image(place)).cells))
    shortlist = Shortlist(small, 12, 10)
    assert shortlist.ends([shortlist.row(describe(image(2)))]).tolist() == [0, 1, 2, 3]
