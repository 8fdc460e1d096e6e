# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Coarse scores: queries and references by their global descriptors."""

from convseq_ros.core.encoding.regions import global_descriptor
from convseq_ros.core.map.place import pack_cells, Place
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.sequence.coarse_scores import CoarseScores
from convseq_ros.core.sequence.shortlist import Shortlist
import numpy as np
import pytest

PLACES = 80


@pytest.fixture(scope='module')
def reference_map(described):
    made = ReferenceMap()
    for place in range(PLACES):
        made.add(Place(place), pack_cells(described(place).cells))
    return made


def standardised(numbers):
    """Return references about their mean, less of their spread, the mean and the variance."""
    count, mean = len(numbers), numbers.mean(axis=0)
    variance = np.maximum(numbers.var(axis=0), 1e-6)
    variance = (count * variance + 20 * variance.mean()) / (count + 20)
    return (numbers - mean) / variance**0.125, mean, variance


def cosines(references, query):
    return references @ query / (np.linalg.norm(references, axis=1) * np.linalg.norm(query))


def test_scores_are_the_cosines_of_what_is_unusual_in_the_map_and_on_the_drive(
    reference_map, described
):
    coarse = CoarseScores(reference_map)
    queries = [described(place, 1) for place in (5, 6, 7)]
    rows = [coarse.update(query) for query in queries]
    own = np.array([global_descriptor(query.cells) for query in queries], float)
    references, mean, variance = standardised(reference_map.global_descriptors.astype(float))
    away = own[2] - (2 * mean + own.sum(axis=0)) / 5
    spread = (3 * own.var(axis=0) + 20 * variance) / 23
    expected = cosines(references, away / spread**0.125)
    assert rows[2].dtype == np.float32 and rows[2] == pytest.approx(expected, abs=1e-5)


def test_only_what_is_usable_is_scored(reference_map, described):
    part = ReferenceMap()
    for index in range(30):
        part.add(reference_map.places[index], reference_map.packed(index))
    query = described(8, 1)
    row = CoarseScores(reference_map).update(query, 30)
    assert (row == CoarseScores(part).update(query)).all()
    assert CoarseScores(reference_map).update(query, 0).shape == (0,)


def test_a_map_that_grows_is_scored_as_far_as_it_goes(reference_map, described):
    growing = ReferenceMap()
    coarse = CoarseScores(growing)
    rows = []
    for place in range(PLACES):
        rows.append(coarse.update(described(place, 1)))
        assert rows[-1].shape == (place,)
        growing.add(reference_map.places[place], reference_map.packed(place))
    late, fresh = coarse.update(described(40, 1)), CoarseScores(growing).update(described(40, 1))
    assert late.argmax() == fresh.argmax() == 40
    rows = [coarse.update(described(place, 1), 60) for place in (50, 51)]
    rows.append(coarse.update(described(52, 1)))
    shortlist = Shortlist(12)
    asked = shortlist.asked(rows[::-1], 10)
    assert 52 in shortlist.update(asked, *coarse.sums([asked]), 10)


def test_the_mean_follows_a_map_that_grows(described):
    rng = np.random.default_rng(0)
    growing, packed = ReferenceMap(), pack_cells(described(0).cells)
    numbers = growing.global_descriptors.shape[1]
    coarse, query = CoarseScores(growing), described(3)
    for count in range(1, 500):
        growing.add(Place(count), packed, known_descriptor=rng.normal(0.2, 0.1, numbers))
        coarse.update(query)
    fresh = CoarseScores(growing)
    fresh.update(query)
    for name in ('mean', 'variance'):
        assert getattr(coarse._usual, name) == pytest.approx(getattr(fresh._usual, name), abs=5e-3)
    references, _, _ = standardised(growing.global_descriptors.astype(float))
    made, fresh_made = coarse._centred._nearness.view, fresh._centred._nearness.view
    assert fresh_made == pytest.approx(1 / np.linalg.norm(references, axis=1), rel=1e-3)
    assert made == pytest.approx(fresh_made, rel=0.05)


def test_references_at_the_mean_tell_nothing(described):
    lonely = ReferenceMap()
    for index in range(3):
        lonely.add(Place(index), pack_cells(described(4).cells))
    assert (CoarseScores(lonely).update(described(4)) == 0).all()


def test_a_session_is_seen_from_what_it_usually_shows(described):
    rng, numbers = np.random.default_rng(0), ReferenceMap().global_descriptors.shape[1]
    town, park = rng.normal(0.0, 0.1, (300, numbers)), rng.normal(0.5, 0.1, (40, numbers))
    made, packed = ReferenceMap(), pack_cells(described(0).cells)
    for place, one in enumerate([*town, *park]):
        if place == len(town):
            made.begin_session(place)
        made.add(Place(place, session=place >= len(town)), packed, known_descriptor=one)
    coarse = CoarseScores(made)
    coarse.update(described(3))
    direction = (park[7] - park.mean(axis=0)).astype(np.float32)
    row = coarse._centred.row(made.global_descriptors, made.bounds.starts, direction)
    assert row.argmax() == len(town) + 7
    # Less what the session usually shows, which the map's mean, as 20 places, draws near.
    assert abs(row[len(town) :].mean()) < 0.3 * row.max()
