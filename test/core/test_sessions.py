# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sessions in one map: diagonals and neighbours stay in theirs, looks of a place are no rivals."""

from dataclasses import replace
from itertools import pairwise
import sys

from convseq_ros.config import Config
from convseq_ros.core.decision.candidates import best_candidates, why_none
from convseq_ros.core.decision.margin import decide_by_margin
from convseq_ros.core.decision.neighbourhood import LOOKS, Neighbourhood
from convseq_ros.core.decision.track_evidence import TrackEvidence
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.geometry.verification import Verification
from convseq_ros.core.map.format import MapSession
from convseq_ros.core.map.place import Place
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.sessions import SessionBounds
from convseq_ros.core.map.writer import save_map
from convseq_ros.core.pose.estimate import estimate_pose
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.sequence.coarse_sums import all_sums
from convseq_ros.core.sequence.diagonals import sequence_scores
from convseq_ros.core.sequence.shortlist import Shortlist
from convseq_ros.core.types import Camera, Candidate, Frame, LocalizationState, Pose, Reason
from convseq_ros.errors import MapError
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

BOUNDS = SessionBounds((10, 25))
AHEAD, BACK = (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 1.0, 0.0)
CELLS = np.ones((32, 32, 8), np.float16)


def a_map(*lengths, frames=(), step_m=1.0, orientation=AHEAD):
    """Return a map of sessions of some places, one after another, each from x = 0."""
    reference_map = ReferenceMap()
    frames = frames or (None,) * len(lengths)
    for number, (length, frame) in enumerate(zip(lengths, frames, strict=True)):
        reference_map.sessions.append(MapSession(f'id {number}', '', number, frame=frame))
        for index in range(length):
            turned = orientation if number else AHEAD
            pose = Pose((index * step_m, 0.0, 0.0), turned)
            reference_map.add(Place(index, pose=pose, session=number), CELLS)
    return reference_map


def test_a_map_knows_where_its_sessions_begin(tmp_path):
    reference_map = a_map(3, 1, 5)
    assert reference_map.bounds.starts.tolist() == [0, 3, 4]
    save_map(reference_map, tmp_path / 'map.db')
    assert open_map(tmp_path / 'map.db').bounds.starts.tolist() == [0, 3, 4]


def test_a_map_whose_sessions_are_mixed_is_refused(tmp_path):
    reference_map = a_map(3, 3)
    reference_map.add(Place(9, session=0), CELLS)
    save_map(reference_map, tmp_path / 'map.db')
    with pytest.raises(MapError, match='places of one session lie apart'):
        open_map(tmp_path / 'map.db')


def test_what_is_near_is_of_the_same_session():
    every = np.arange(30)
    assert np.flatnonzero(BOUNDS.near(every, 9, 3)).tolist() == [6, 7, 8, 9]
    assert np.flatnonzero(BOUNDS.near(every, 10, 3)).tolist() == [10, 11, 12, 13]
    assert np.flatnonzero(BOUNDS.near(every, 24, 30)).tolist() == [*range(10, 25)]
    firsts, ends = BOUNDS.spans(np.array([0, 9, 10, 24, 25, 99]))
    assert firsts.tolist() == [0, 0, 10, 10, 25, 25]
    assert ends.tolist() == [10, 10, 25, 25, sys.maxsize, sys.maxsize]
    assert BOUNDS.span(12) == (10, 25) and BOUNDS.span(25)[0] == 25


@given(
    st.lists(st.integers(1, 30), min_size=1, max_size=5),
    st.integers(1, 8),
    st.sampled_from([0.5, 1.0, 2.0]),
    st.integers(0, 99),
)
def test_sequence_scores_of_a_map_are_those_of_its_sessions(lengths, frames, velocity, seed):
    starts = np.cumsum([0, *lengths])
    rows = list(np.random.default_rng(seed).random((frames, starts[-1])).astype(np.float32))
    found = sequence_scores(rows, velocity, bounds=SessionBounds(tuple(starts[:-1].tolist())))
    alone = [
        sequence_scores([row[start:end] for row in rows], velocity)
        for start, end in pairwise(starts)
    ]
    assert np.array_equal(found, np.concatenate(alone))


def test_a_sequence_does_not_run_from_one_session_into_the_next():
    rows = [np.zeros(30, np.float32) for _ in range(6)]
    for past, row in enumerate(rows):
        row[12 - past] = 1.0  # three frames in one session, three in the one before
    assert sequence_scores(rows)[12] == 1.0
    assert sequence_scores(rows, bounds=BOUNDS)[12] == -np.inf
    half = sequence_scores(rows, bounds=BOUNDS, partial=True)[12]
    assert half == pytest.approx((3 + 3 / 30) / 6)


def test_the_shortlist_follows_no_place_into_another_session():
    rows = [np.random.default_rng(0).random(60).astype(np.float32) / 10 for _ in range(2)]
    rows[1][[29, 45]] = 9.0, 8.0  # of the older frame
    for bounds, later in ((SessionBounds((30,)), {46}), (SessionBounds(), {30, 46})):
        shortlist = Shortlist(2, bounds)
        asked = shortlist.asked(rows[1:], 5)
        assert shortlist.update(asked, all_sums(asked, bounds), 5).tolist() == [29, 45]
        assert set(shortlist.asked(rows, 5).known.tolist()) == later


def test_candidates_of_two_sessions_are_no_neighbours_and_tell_theirs():
    scores, config = np.full(30, 0.1), Config().acceptance
    scores[[9, 10, 12]] = 0.9, 0.8, 0.7
    places = a_map(10, 20).places
    found = best_candidates(np.arange(30), scores, places, config, SessionBounds((10,)))
    assert [(one.reference_index, one.session) for one in found[:2]] == [(9, 0), (10, 1)]
    assert best_candidates(np.arange(30), scores, places, config)[1].reference_index == 20


def test_a_map_of_short_sessions_is_too_short():
    assert why_none(30, 16, 1.0, BOUNDS) is Reason.MAP_TOO_SHORT
    assert why_none(30, 15, 1.0, BOUNDS) is Reason.WARMING_UP
    assert why_none(30, 16, 1.0, SessionBounds()) is Reason.WARMING_UP


def test_a_pose_is_between_places_of_its_own_session():
    places = a_map(5, 5, step_m=3.0).places
    assert estimate_pose(places, 4).covariance[0, 0] == pytest.approx(9 / 12)
    assert estimate_pose(places, 5).covariance[0, 0] == pytest.approx(9 / 12)


def said(strengths):
    """Return a comparison of references by made-up strengths of pairs."""
    asked = []

    def compare(index, others):
        asked.append((index, *others))
        return {one: Verification(0, strengths.get((index, one), 30.0), 0.0) for one in others}

    return compare, asked


def test_a_rival_that_shows_the_same_by_geometry_is_a_look():
    compare, asked = said({(20, 70): 200.0})
    known, scores = Neighbourhood(a_map(50, 50), compare), np.zeros(100)
    scores[[20, 70]] = 0.9, 0.8
    known.follow(20, np.arange(100), scores, 10, 5)
    assert known.looks(20) == [70] and known.looks(70) == [20]
    assert known.looks(22) == [72] and known.looks(20 + LOOKS.reach + 1) == []
    assert known.is_near(20, 73, 3) and not known.is_near(20, 74, 3)
    assert known.near(np.array([15, 60, 69, 90]), 20, 5).tolist() == [True, False, True, False]
    before = len(asked)
    known.follow(21, np.arange(100), np.roll(scores, 1), 10, 5)
    assert known.looks(21) == [71] and asked[0][:2] == (20, 70)
    assert all(70 not in one for one in asked[before:])  # what is known is not asked again


def test_a_rival_that_shows_something_else_stays_one_and_is_asked_once():
    compare, asked = said({})
    known, scores = Neighbourhood(a_map(50, 50), compare), np.zeros(100)
    scores[[20, 70]] = 0.9, 0.8
    for step in range(LOOKS.reach):
        known.follow(20 + step, np.arange(100), np.roll(scores, step), 10, 5)
        assert known.looks(20 + step) == []
    assert len(asked) == 1


@pytest.mark.parametrize(
    ('frames', 'orientation', 'is_look'),
    [
        (('town', 'town'), AHEAD, True),
        (('town', 'town'), BACK, False),
        (('town', 'other'), AHEAD, False),
        ((None, None), AHEAD, False),
    ],
    ids=['one_frame', 'other_way', 'two_frames', 'no_frame'],
)
def test_poses_of_one_frame_tell_looks_without_geometry(frames, orientation, is_look):
    known = Neighbourhood(a_map(50, 50, frames=frames, orientation=orientation))
    scores = np.zeros(100)
    scores[[20, 71]] = 0.9, 0.8
    known.follow(20, np.arange(100), scores, 10, 5)
    assert known.looks(20) == ([71] if is_look else [])
    found = tuple(Candidate(one, one, score) for one, score in ((20, 0.9), (71, 0.89), (5, 0.2)))
    rule = replace(Config().acceptance, min_margin=0.1)
    reason = decide_by_margin(found, rule, known)
    assert reason is (Reason.ACCEPTED if is_look else Reason.AMBIGUOUS)


@pytest.mark.parametrize('orientation', [AHEAD, BACK])
def test_a_rear_camera_sees_what_the_front_one_does_where_the_robot_is_turned(orientation):
    whole = a_map(50, 50, frames=('town', 'town'), orientation=orientation)
    behind = Camera(80, 60, 50.0, 50.0, 40.0, 30.0, mount=Pose((0.0, 0.0, 0.0), BACK))
    whole.sessions[1] = replace(whole.sessions[1], camera=behind)
    known, scores = Neighbourhood(whole), np.zeros(100)
    scores[[20, 71]] = 0.9, 0.8
    known.follow(20, np.arange(100), scores, 10, 5)
    assert known.looks(20) == ([71] if orientation == BACK else [])


def test_a_track_goes_on_where_another_look_scores_better():
    compare, _ = said({(one, one + 50): 200.0 for one in range(50)})
    evidence = TrackEvidence(Neighbourhood(a_map(50, 50), compare))
    alone, rng, rows = TrackEvidence(), np.random.default_rng(0), []
    for frame in range(30):
        row = rng.uniform(0.08, 0.12, 100).astype(np.float32)
        here, look = frame + 5, frame + 55
        row[[here, look]] = (0.6, 0.59) if frame % 4 < 2 else (0.59, 0.6)
        rows = [row, *rows][:8]
        for one in (evidence, alone):
            newest = one.update(frame, rows, np.arange(100), 10)
    assert newest.reference in (here, look)
    assert evidence.evidence(29, look) > 1 > alone.evidence(29, look)


def test_two_drives_of_one_way_answer_as_one_and_say_which(image):
    def drive(seed, start_ns):
        return [Frame(start_ns + index * 10**9, image(index, seed)) for index in range(40)]

    reference_map = ReferenceMap()
    for number in (1, 2):
        reference_map.begin_session(number * 10**12)
        for frame in drive(number, number * 10**12):
            reference_map.add_frame(frame, describe(frame.gray))
    recognizer = PlaceRecognizer(reference_map, Config())
    matches = [recognizer.process(frame) for frame in drive(3, 9 * 10**12)]
    accepted = [one for one in matches if one.accepted]
    assert len(accepted) >= 30
    for one in accepted:
        assert one.best.reference_index % 40 == one.query_index
        assert one.best.session == one.best.reference_index // 40
    states = [one.localization.state for one in matches]
    found = states.index(LocalizationState.LOCALISED)
    assert set(states[found:]) == {LocalizationState.LOCALISED}
    assert len({one.best.session for one in accepted}) == 2
