# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Coarse scores: queries and references by their global descriptors, and along the drive."""

import tracemalloc

from convseq_ros.core.encoding.regions import global_descriptor
from convseq_ros.core.map.place import pack_cells, Place
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.retrieval.coarse_scores import CoarseScores, top, TRACK, Track
from convseq_ros.core.retrieval.whitening import statistics_of, sums_of, WhitenedReferences
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from world import map_of

PLACES = 80


@pytest.fixture(scope='module')
def reference_map(described):
    return map_of(map(described, range(PLACES)))


def row_of(coarse, query, usable=None):
    """Return what the newest query scores, once it is taken in."""
    coarse.update(query, usable)
    return coarse.row


def test_scores_are_cosines_of_descriptors_whitened_by_map_and_drive(reference_map, described):
    coarse = CoarseScores(reference_map)
    queries = [described(place, 1) for place in (5, 6, 7)]
    rows = [row_of(coarse, query) for query in queries]
    own = np.array([global_descriptor(query.cells) for query in queries], float)
    # References about their mean, less of their spread.
    numbers = reference_map.global_descriptors.astype(float)
    mean, variance = numbers.mean(axis=0), np.maximum(numbers.var(axis=0), 1e-6)
    variance = (PLACES * variance + 20 * variance.mean()) / (PLACES + 20)
    references = (numbers - mean) / variance**0.125
    spread = (3 * own.var(axis=0) + 20 * variance) / 23
    query = (own[2] - (2 * mean + own.sum(axis=0)) / 5) / spread**0.125
    lengths = np.linalg.norm(references, axis=1) * np.linalg.norm(query)
    assert rows[2].dtype == np.float32
    assert rows[2] == pytest.approx(references @ query / lengths, abs=1e-5)


def test_a_growing_map_is_scored_up_to_its_newest_place(reference_map, described):
    growing = ReferenceMap()
    coarse = CoarseScores(growing)
    rows = []
    for place in range(PLACES):
        rows.append(row_of(coarse, described(place, 1)))
        assert rows[-1].shape == (place,)
        growing.add(reference_map.places[place], reference_map.packed(place))
    late = row_of(coarse, described(40, 1))
    fresh = row_of(CoarseScores(growing), described(40, 1))
    assert late.argmax() == fresh.argmax() == 40
    coarse.reset()
    for place, usable in ((50, 60), (51, 60), (52, None)):
        assert row_of(coarse, described(place, 1), usable).argmax() == place
    assert 52 in coarse.best(3, 0)


def test_scores_are_relative_to_the_mean_view_of_a_session(described):
    rng, numbers = np.random.default_rng(0), ReferenceMap().global_descriptors.shape[1]
    town, park = rng.normal(0.0, 0.1, (300, numbers)), rng.normal(0.5, 0.1, (40, numbers))
    made, packed = ReferenceMap(), pack_cells(described(0).cells)
    for place, one in enumerate([*town, *park]):
        if place == len(town):
            made.begin_session(place)
        made.add(Place(place, session=place >= len(town)), packed, descriptor=one)
    coarse = CoarseScores(made)
    coarse.update(described(3))
    direction = (park[7] - park.mean(axis=0)).astype(np.float32)
    row = coarse._whitened.row(made.global_descriptors, made.bounds.starts, direction)
    assert row.argmax() == len(town) + 7
    # Less what the session usually shows, which the map's mean, as 20 places, draws near.
    assert abs(row[len(town) :].mean()) < 0.3 * row.max()


def test_the_best_places_are_those_by_drive_and_by_newest_frame(reference_map, described):
    coarse = CoarseScores(reference_map)
    for place in range(20, 26):
        coarse.update(described(place, 1))
    coarse.update(described(60, 1))  # one frame of another place
    along, newest = set(coarse.best(2, 0).tolist()), set(coarse.best(0, 2).tolist())
    assert 26 in along and 60 in newest
    assert set(coarse.best(2, 2).tolist()) == along | newest
    passed = coarse.best(2, 2, [range(55, 65), range(20, 30)])
    assert not {*range(55, 65), *range(20, 30)} & set(passed.tolist()) and len(passed) > 1
    assert (np.diff(coarse.best(40, 10)) > 0).all()
    coarse.reset()
    coarse.update(described(60, 1))
    assert coarse.best(1, 1).tolist() == [60]


@pytest.mark.parametrize('count', [0, 1, 30, 64 * 33, 64 * 34, 64 * 40 + 7, 9000])
def test_the_best_are_found_without_sorting_all(count):
    rng = np.random.default_rng(count)
    for scores in (rng.normal(size=count), rng.integers(0, 4, count).astype(float)):
        scores = scores.astype(np.float32)
        scores[rng.integers(0, max(1, count), count // 3)] = -np.inf
        found = top(scores, 33)
        assert len(found) == len(set(found.tolist())) == min(33, np.isfinite(scores).sum())
        expected = np.sort(scores)[::-1][: len(found)]
        assert (scores[found] == expected).all()
        passed = [range(0, count // 2), range(-5, 3)]
        assert (top(scores, 33, passed) >= count // 2).all()
        assert len(top(scores, 0)) == 0


def brute_force(rows, starts, both):
    """Return, place by place, its score and most of the best of the places that led there."""
    sums = rows[0].astype(float)
    for row in rows[1:]:
        session = np.searchsorted(starts, np.arange(len(row)), 'right')
        before = np.append(sums, np.full(len(row) - len(sums), sums.min()))
        sums = np.empty(len(row))
        for place in range(len(row)):
            last = place + TRACK.reach if both else place
            near = range(max(0, place - TRACK.reach), min(last, len(row) - 1) + 1)
            led = [before[one] for one in near if session[one] == session[place]]
            sums[place] = row[place] + TRACK.memory * max(led)
    return sums


@settings(max_examples=150)
@given(
    st.integers(1, 40),
    st.lists(st.integers(0, 5), max_size=6),
    st.sets(st.integers(1, 70), max_size=6),
    st.booleans(),
    st.integers(0, 999),
)
def test_sums_are_those_of_the_recursion(count, grown, starts, both, seed):
    rng, track = np.random.default_rng(seed), Track(both)
    lengths = np.cumsum([count, *grown])
    rows = [rng.normal(0, 1, length).astype(np.float32) for length in lengths]
    own = np.array([0, *sorted(starts)])
    for row in rows:
        track.update(row, own[own < len(row)])
    assert track.sums.dtype == np.float32
    assert track.sums == pytest.approx(brute_force(rows, own, both), abs=1e-4)


def test_whitening_takes_5_mb_whatever_the_size_of_the_map():
    references = np.random.default_rng(0).random((10_000, 252)).astype(np.float16)
    tracemalloc.start()
    statistics = statistics_of(sums_of(references), len(references))
    WhitenedReferences(statistics, references, np.zeros(1, np.int64))
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 5_000_000
