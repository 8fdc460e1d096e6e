# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The shortlist."""

from convseq_ros.config import (
    AcceptanceConfig,
    Config,
    EVERY_FRAME,
    MatchingConfig,
    MotionConfig,
    SequenceConfig,
)
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.map.place import pack_cells, Place
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.sessions import SessionBounds
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.sequence.coarse_scores import CoarseScores
from convseq_ros.core.sequence.coarse_sums import all_sums, top
from convseq_ros.core.sequence.diagonals import sequence_scores
from convseq_ros.core.sequence.shortlist import SHORTLIST, Shortlist
from convseq_ros.core.types import Frame, Status
from convseq_ros.sources import open_source
import cv2
import numpy as np
import pytest

PLACES = 80


def update(shortlist, rows, rivals):
    asked = shortlist.asked(rows, rivals)
    return shortlist.update(asked, all_sums(asked), rivals)


@pytest.fixture(scope='module')
def reference_map(described):
    made = ReferenceMap(keyframes=EVERY_FRAME)
    for place in range(PLACES):
        made.add(Place(place), pack_cells(described(place).cells))
    return made


@pytest.fixture(scope='module')
def run(image):
    """Return a way to drive past places."""

    def drive_past(reference_map, search, places, verification=True, **more):
        config = Config(
            matching=MatchingConfig(matching='coherent', search=search, **more),
            acceptance=AcceptanceConfig(verification=verification),
            sequence=SequenceConfig(fixed_length=5),
        )
        recognizer = PlaceRecognizer(reference_map, config)
        return [
            recognizer.process(Frame(index, image(place, seed=1)))
            for index, place in enumerate(places)
        ]

    return drive_past


def test_the_shortlist_finds_what_exhaustive_search_finds_with_fewer_pairs(reference_map, run):
    places = range(20, 20 + SHORTLIST.first_frames + 8)
    listed = run(reference_map, 'shortlist', places, shortlist_length=12)
    scored = run(reference_map, 'exhaustive', places)
    for place, short, whole in list(zip(places, listed, scored, strict=True))[4:]:
        assert short.best.reference_index == whole.best.reference_index == place
        assert short.best.score == pytest.approx(whole.best.score)
        assert short.best.shift == whole.best.shift
    # The first frames of a drive look at many places, each once.
    assert {match.pairs_scored for match in listed[: SHORTLIST.first_frames]} == {PLACES}
    later = [match.pairs_scored for match in listed[SHORTLIST.first_frames :]]
    assert max(later) < 12 * 5 and np.mean(later) < PLACES
    assert all(match.pairs_scored == PLACES for match in scored)


def test_rivals_are_on_the_shortlist(reference_map, run):
    listed = run(reference_map, 'shortlist', range(30, 45), shortlist_length=12)
    assert all(len(match.candidates) > 1 for match in listed[4:])


def test_ends_lie_where_the_window_fits_and_are_ascending(reference_map, described):
    coarse = CoarseScores(reference_map)
    rows = [coarse.update(described(place)) for place in (5, 6, 7)]
    ends = update(Shortlist(12), rows[::-1], 10)
    assert 7 in ends and ends.min() >= 2 and (np.diff(ends) > 0).all() and len(ends) <= 12


def test_a_short_map_is_listed_whole(described):
    small = ReferenceMap()
    for place in range(4):
        small.add(Place(place), pack_cells(described(place).cells))
    rows = [CoarseScores(small).update(described(2))]
    assert update(Shortlist(12), rows, 10).tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize('seed', range(5))
def test_ends_are_the_best_and_then_the_best_elsewhere(seed):
    scores = np.random.default_rng(seed).random(300).astype(np.float32)
    ends = update(Shortlist(12), [scores], 10)
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
    made = ReferenceMap(keyframes=EVERY_FRAME)
    for index, one in enumerate(references):
        made.add(Place(index), pack_cells(one.cells))
    config = Config(
        matching=MatchingConfig(matching='coherent', search=search),
        sequence=SequenceConfig(fixed_length=10),
        motion=MotionConfig(stationary_overlap=1.0),
    )
    recognizer = PlaceRecognizer(made, config)
    matches = [recognizer.process(Frame(index, None), one) for index, one in enumerate(queries)]
    found = [match.best.reference_index for match in matches[9:]]
    return np.mean(np.abs(np.array(found) - np.arange(9, len(queries))) <= 2)


@pytest.mark.once
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
        dark = (frame.gray / np.float32(255)) ** 3.4 * (0.25 + 0.75 * lamp)
        dark = cv2.GaussianBlur(dark + rng.normal(0, 0.09, dark.shape), (0, 0), 2.8)
        dark += rng.normal(0, 0.03, dark.shape)
        bright = np.clip(dark / np.percentile(dark, 99.5), 0, 1) ** 0.6
        yield describe((255 * bright).astype(np.uint8))


@pytest.mark.once
def test_the_shortlist_finds_places_in_the_dark(shared_data):
    folder = shared_data / 'gardens_point'
    queries = list(darkened(list(open_source(folder / 'day_left'))[:60]))
    references = drive(folder / 'day_right', 0, 60)
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


def test_listed_diagonals_are_kept_rather_than_others_that_are_hardly_better():
    rows = drawn_rows(400)
    shortlist, new = Shortlist(20), []
    listed = update(shortlist, rows[4::-1], 5)
    for frame in range(5, 12):
        window = rows[frame : frame - 5 : -1]
        before, listed = set((listed + 1).tolist()), update(shortlist, window, 5)
        new.append(len(set(listed.tolist()) - before))
        fresh = update(Shortlist(20), window, 5)
        assert sequence_scores(window).argmax() in listed and len(fresh) == 20
    assert max(new) <= 4


def test_sequences_that_were_verified_stay_listed():
    rows = drawn_rows(400)
    shortlist, forgetful = Shortlist(20), Shortlist(20)
    listed = update(shortlist, rows[4::-1], 5)
    assert (update(forgetful, rows[4::-1], 5) == listed).all()
    scores = np.zeros(len(listed))
    worst = np.argsort(sequence_scores(rows[4::-1])[listed])[:4]
    scores[worst] = 1.0
    shortlist.verify(listed, scores)
    window = [rows[8], None, *rows[6:3:-1]]
    later = {index + 4 for index in listed[worst].tolist() if index < 396}
    assert later <= set(update(shortlist, window, 5).tolist())
    assert not later <= set(update(forgetful, window, 5).tolist())
    assert not len(shortlist._verified)


def test_fewer_are_listed_while_the_place_is_known():
    rows = drawn_rows(400)
    shortlist, counts = Shortlist(20), []
    for is_known in (True, True, False, False, False, False):
        listed = update(shortlist, rows[4::-1], 5)
        shortlist.verify(listed, np.zeros(len(listed)), is_known)
        counts.append(len(listed))
    assert counts == [20, 12, 12, 14, 16, 18]  # 20 / 7 may be new in a frame
    shortlist.reset()
    assert len(update(shortlist, rows[4::-1], 5)) == 20


def test_the_recogniser_tells_how_listed_sequences_scored(reference_map, run, monkeypatch):
    told = []
    monkeypatch.setattr(Shortlist, 'verify', lambda _, *asked: told.append(asked))
    matches = run(reference_map, 'shortlist', range(20, 30), False, shortlist_length=12)
    answered = [match for match in matches if match.candidates]
    assert len(told) == len(answered) == 6
    for (ends, scores, is_known), match in zip(told, answered, strict=True):
        assert is_known == (match.status is Status.ACCEPTED)
        assert ends[scores.argmax()] == match.best.reference_index
        assert scores.max() == match.best.score


def test_a_frame_that_never_came_does_not_end_the_diagonals():
    rows = drawn_rows(400)
    shortlist = Shortlist(20)
    listed = update(shortlist, rows[4::-1], 5)
    later = update(shortlist, [rows[6], None, *rows[4::-1]], 5)
    assert len(set(later.tolist()) - set((listed + 2).tolist())) <= 4


def test_the_top_of_another_number_of_ends_is_not_remembered():
    rows = drawn_rows(400)
    one, other = (Shortlist(20) for _ in range(2))
    for frame in range(5, 9):
        window = rows[frame : frame - 5 : -1]
        assert len(one.top(all_sums(one.asked(window, 5, 2.0)), 5, 12)) == 12
        assert (update(one, window, 5) == update(other, window, 5)).all()


def test_all_places_of_the_likeliest_single_peaks_are_listed():
    shortlist, best = Shortlist(20, SessionBounds((10,))), np.array([12, 40, 98, 60])
    listed = shortlist.around(best, usable=100).tolist()
    assert listed == [*range(10, 17), *range(36, 45), *range(94, 100)]


def test_where_no_sequence_finds_room_nothing_is_listed():
    rows = list(drawn_rows(PLACES, 8))
    shortlist = Shortlist(20)
    assert len(update(shortlist, rows[:2], 5))
    lost = [np.full(PLACES, np.nan, np.float32), *rows]
    assert len(update(shortlist, lost, 5)) == 0


@pytest.mark.parametrize('count', [1, 30, 64 * 33, 64 * 34, 64 * 40 + 7, 9000])
def test_the_best_are_found_without_sorting_all(count):
    rng = np.random.default_rng(count)
    for scores in (rng.normal(size=count), rng.integers(0, 4, count).astype(float)):
        scores[rng.integers(0, count, count // 3)] = -np.inf
        found = top(scores, 33)
        assert (np.diff(found) > 0).all()
        expected = np.sort(scores)[::-1][:33]
        assert (np.sort(scores[found])[::-1][:33] == expected).all()
    if count > 64 * 33:
        assert len(top(rng.normal(size=count), 33)) < count / 4


def test_a_list_of_few_takes_in_a_new_one_all_the_same():
    rows = drawn_rows(400)
    shortlist = Shortlist(4)
    assert 300 not in update(shortlist, rows[4::-1], 5)
    better = rows[5].copy()
    better[300] += 50
    assert 300 in update(shortlist, [better, *rows[4:0:-1]], 5)
