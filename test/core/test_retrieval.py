# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The shortlist."""

from convseq_ros.config import Config, MatchingConfig, SequenceConfig
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.encoding.global_descriptor import pooled
from convseq_ros.core.map.reference_map import pack_cells, Place, ReferenceMap
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.sequence import shortlist as retrieval
from convseq_ros.core.sequence.diagonals import sequence_scores
from convseq_ros.core.sequence.shortlist import Shortlist
from convseq_ros.core.types import Frame
from convseq_ros.sources import open_source
import cv2
import numpy as np
import pytest

PLACES = 80


@pytest.fixture(scope='module')
def described(image):
    """Return a maker of descriptors."""
    return lambda place, seed=0: describe(image(place, seed))


@pytest.fixture(scope='module')
def reference_map(described):
    made = ReferenceMap()
    for place in range(PLACES):
        made.add(Place(place), pack_cells(described(place).cells))
    return made


@pytest.fixture(scope='module')
def run(image):
    """Return a way to drive past places."""

    def drive_past(reference_map, search, places, **more):
        config = Config(
            matching=MatchingConfig(matching='coherent', search=search, **more),
            sequence=SequenceConfig(fixed_length=5),
        )
        recognizer = PlaceRecognizer(reference_map, config)
        return [
            recognizer.process(Frame(index, image(place, seed=1)))
            for index, place in enumerate(places)
        ]

    return drive_past


def test_the_shortlist_finds_what_exhaustive_search_finds_with_fewer_pairs(reference_map, run):
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


def test_rivals_are_on_the_shortlist(reference_map, run):
    listed = run(reference_map, 'shortlist', range(30, 45), shortlist_length=12)
    assert all(len(match.candidates) > 1 for match in listed[4:])


def test_ends_lie_where_the_window_fits_and_are_ascending(reference_map, described):
    shortlist = Shortlist(reference_map, 12, 10)
    rows = [shortlist.row(described(place)) for place in (5, 6, 7)]
    ends = shortlist.ends(rows[::-1])
    assert 7 in ends and ends.min() >= 2 and (np.diff(ends) > 0).all() and len(ends) <= 12


def test_a_short_map_is_listed_whole(described):
    small = ReferenceMap()
    for place in range(4):
        small.add(Place(place), pack_cells(described(place).cells))
    shortlist = Shortlist(small, 12, 10)
    assert shortlist.ends([shortlist.row(described(2))]).tolist() == [0, 1, 2, 3]


def standardised(looks):
    """Return references about their mean, less of their spread, the mean and the variance."""
    count, mean = len(looks), looks.mean(axis=0)
    variance = np.maximum(looks.var(axis=0), 1e-6)
    variance = (count * variance + 20 * variance.mean()) / (count + 20)
    return (looks - mean) / variance**0.125, mean, variance


def cosines(references, query):
    return references @ query / (np.linalg.norm(references, axis=1) * np.linalg.norm(query))


def test_a_row_holds_the_cosines_of_what_is_unusual_in_the_map_and_on_the_drive(
    reference_map, described
):
    shortlist = Shortlist(reference_map, 12, 10)
    queries = [described(place, 1) for place in (5, 6, 7)]
    rows = [shortlist.row(query) for query in queries]
    seen = np.array([pooled(query.cells) for query in queries], float)
    references, mean, variance = standardised(reference_map.pooled.astype(float))
    away = seen[2] - (2 * mean + seen.sum(axis=0)) / 5
    spread = (3 * seen.var(axis=0) + 20 * variance) / 23
    expected = cosines(references, away / spread**0.125)
    assert rows[2].dtype == np.float32 and rows[2] == pytest.approx(expected, abs=1e-5)


def test_only_what_is_usable_is_looked_at(reference_map, described):
    part = ReferenceMap()
    for index in range(30):
        part.add(reference_map.places[index], reference_map.packed(index))
    query = described(8, 1)
    row = Shortlist(reference_map, 12, 10).row(query, 30)
    assert (row == Shortlist(part, 12, 10).row(query)).all()
    assert Shortlist(reference_map, 12, 10).row(query, 0).shape == (0,)


def test_a_shortlist_sees_a_map_grow(reference_map, described):
    growing = ReferenceMap()
    shortlist = Shortlist(growing, 12, 10)
    rows = []
    for place in range(PLACES):
        rows.append(shortlist.row(described(place, 1)))
        assert rows[-1].shape == (place,)
        growing.add(reference_map.places[place], reference_map.packed(place))
    late, fresh = shortlist.row(described(40, 1)), Shortlist(growing, 12, 10).row(described(40, 1))
    assert late.argmax() == fresh.argmax() == 40
    rows = [shortlist.row(described(place, 1), 60) for place in (50, 51)]
    rows.append(shortlist.row(described(52, 1)))
    assert 52 in shortlist.ends(rows[::-1])


def test_the_mean_follows_a_map_that_grows(described):
    rng = np.random.default_rng(0)
    growing, packed = ReferenceMap(), pack_cells(described(0).cells)
    numbers = growing.pooled.shape[1]
    shortlist, query = Shortlist(growing, 12, 10), described(3)
    for count in range(1, 500):
        growing.add(Place(count), packed, first_sight=rng.normal(0.2, 0.1, numbers))
        shortlist.row(query)
    fresh = Shortlist(growing, 12, 10)
    fresh.row(query)
    for name in ('_mean', '_variance'):
        assert getattr(shortlist, name) == pytest.approx(getattr(fresh, name), abs=5e-3)
    references, _, _ = standardised(growing.pooled.astype(float))
    assert fresh._nearness.view == pytest.approx(1 / np.linalg.norm(references, axis=1), rel=1e-3)
    assert shortlist._nearness.view == pytest.approx(fresh._nearness.view, rel=0.05)


def test_references_at_the_mean_tell_nothing(described):
    lonely = ReferenceMap()
    for index in range(3):
        lonely.add(Place(index), pack_cells(described(4).cells))
    assert (Shortlist(lonely, 12, 10).row(described(4)) == 0).all()


@pytest.mark.parametrize('seed', range(5))
def test_ends_are_the_best_and_then_the_best_elsewhere(seed, reference_map):
    scores = np.random.default_rng(seed).random(300).astype(np.float32)
    ends = Shortlist(reference_map, 12, 10).ends([scores])
    best = set(np.argsort(-scores)[:9].tolist())
    assert best <= set(ends.tolist()) and len(ends) == 12
    elsewhere = sorted(set(ends.tolist()) - best, key=lambda index: -scores[index])
    taken = np.array(sorted(best))
    for index in elsewhere:
        free = np.abs(np.arange(300)[:, None] - taken).min(axis=1) > 10
        assert index == np.where(free, scores, -1).argmax()
        taken = np.append(taken, index)


def drive(folder, first, last):
    frames = list(open_source(folder))[first:last]
    return [describe(frame.gray) for frame in frames]


def accuracy(queries, references, search):
    """Return the share of frames that are found within two frames, ten matched together."""
    made = ReferenceMap()
    for index, one in enumerate(references):
        made.add(Place(index), pack_cells(one.cells))
    config = Config(
        matching=MatchingConfig(matching='coherent', search=search),
        sequence=SequenceConfig(fixed_length=10),
    )
    recognizer = PlaceRecognizer(made, config)
    matches = [recognizer.recognize(index, one) for index, one in enumerate(queries)]
    found = [match.best.reference_index for match in matches[9:]]
    return np.mean(np.abs(np.array(found) - np.arange(9, len(queries))) <= 2)


@pytest.mark.parametrize(
    ('query', 'reference', 'first', 'last'),
    [
        ('gardens_point/day_left', 'gardens_point/day_right', 60, 130),
        ('corridor/query', 'corridor/ref', 20, 90),
    ],
)
def test_the_shortlist_is_as_accurate_as_exhaustive_search(
    shared_data, query, reference, first, last
):
    queries = drive(shared_data / query, first, last)
    references = drive(shared_data / reference, first, last)
    listed = accuracy(queries, references, 'shortlist')
    assert listed >= accuracy(queries, references, 'exhaustive') - 0.01


def darkened(frames):
    """Return images with their contrast crushed, lit by a lamp, full of noise, and blurred."""
    rng = np.random.default_rng(5)
    for frame in frames:
        height, width = frame.gray.shape
        down, across = np.mgrid[0:height, 0:width].astype(np.float32)
        lamp = np.exp(-((across / width - 0.5) ** 2 + (down / height - 0.75) ** 2) / 0.12)
        seen = (frame.gray / np.float32(255)) ** 3.4 * (0.25 + 0.75 * lamp)
        seen = cv2.GaussianBlur(seen + rng.normal(0, 0.09, seen.shape), (0, 0), 2.8)
        seen += rng.normal(0, 0.03, seen.shape)
        bright = np.clip(seen / np.percentile(seen, 99.5), 0, 1) ** 0.6
        yield describe((255 * bright).astype(np.uint8))


def test_the_shortlist_finds_places_in_the_dark(shared_data):
    folder = shared_data / 'gardens_point'
    queries = list(darkened(list(open_source(folder / 'day_left'))[:100]))
    references = drive(folder / 'day_right', 0, 100)
    assert accuracy(queries, references, 'exhaustive') > 0.98
    assert accuracy(queries, references, 'shortlist') > 0.94


def drawn_rows(count, frames=12):
    """Return rows in which diagonals are a little like themselves from frame to frame."""
    rng = np.random.default_rng(3)
    tracks = rng.normal(0, 1, count + frames)
    rows = [
        (tracks[frames - frame :][:count] + rng.normal(0, 1.5, count)).astype(np.float32)
        for frame in range(frames)
    ]
    return rows


def test_listed_diagonals_are_kept_rather_than_others_that_are_hardly_better(reference_map):
    rows = drawn_rows(400)
    shortlist, new = Shortlist(reference_map, 20, 5), []
    listed = shortlist.ends(rows[4::-1])
    for frame in range(5, 12):
        window = rows[frame : frame - 5 : -1]
        before, listed = set((listed + 1).tolist()), shortlist.ends(window)
        new.append(len(set(listed.tolist()) - before))
        fresh = Shortlist(reference_map, 20, 5).ends(window)
        assert sequence_scores(window).argmax() in listed and len(fresh) == 20
    assert max(new) <= 4


def test_sequences_that_have_proven_themselves_stay_listed(reference_map):
    rows = drawn_rows(400)
    shortlist = Shortlist(reference_map, 20, 5)
    listed = shortlist.ends(rows[4::-1])
    scores = np.zeros(len(listed))
    worst = np.argsort(sequence_scores(rows[4::-1])[listed])[:4]
    scores[worst] = 1.0
    shortlist.prove(listed, scores)
    later = shortlist.ends([rows[6], None, *rows[4::-1]])
    assert {index + 2 for index in listed[worst].tolist() if index < 398} <= set(later.tolist())
    assert not len(shortlist._proven)


def test_a_frame_that_never_came_does_not_end_the_diagonals(reference_map):
    rows = drawn_rows(400)
    shortlist = Shortlist(reference_map, 20, 5)
    listed = shortlist.ends(rows[4::-1])
    later = shortlist.ends([rows[6], None, *rows[4::-1]])
    assert len(set(later.tolist()) - set((listed + 2).tolist())) <= 4


def test_a_look_at_another_number_of_ends_is_not_remembered(reference_map):
    rows = drawn_rows(400)
    one, other = (Shortlist(reference_map, 20, 5) for _ in range(2))
    for frame in range(5, 9):
        window = rows[frame : frame - 5 : -1]
        assert len(one.ends(window, 2.0, 12)) == 12
        assert (one.ends(window) == other.ends(window)).all()


def test_where_no_sequence_finds_room_nothing_is_listed(reference_map):
    rows = list(drawn_rows(PLACES, 8))
    shortlist = Shortlist(reference_map, 20, 5)
    assert len(shortlist.ends(rows[:2]))
    lost = [np.full(PLACES, np.nan, np.float32), *rows]
    assert len(shortlist.ends(lost)) == 0


@pytest.mark.parametrize('count', [1, 30, 64 * 33, 64 * 34, 64 * 40 + 7, 9000])
def test_the_best_are_found_without_sorting_all(count):
    rng = np.random.default_rng(count)
    for scores in (rng.normal(size=count), rng.integers(0, 4, count).astype(float)):
        scores[rng.integers(0, count, count // 3)] = -np.inf
        found = retrieval._among_the_best(scores, 33)
        assert (np.diff(found) > 0).all()
        expected = np.sort(scores)[::-1][:33]
        assert (np.sort(scores[found])[::-1][:33] == expected).all()
    if count > 64 * 33:
        assert len(retrieval._among_the_best(rng.normal(size=count), 33)) < count / 4
