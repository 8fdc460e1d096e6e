# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps keep so many looks of a place: which go, that nothing else does, and what is said of it."""

from unittest.mock import Mock

from convseq_ros.app.map_builder import build_map, MapBuilder
from convseq_ros.app.pipeline import Pipeline
from convseq_ros.config import EncodingConfig, make_config
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.map.edit import prune_looks
from convseq_ros.core.map.online import OnlineMap, recognised_place
from convseq_ros.core.map.place import Place
from convseq_ros.core.map.pruning import Pruning, STRETCH
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.writer import save_map
from convseq_ros.core.types import Anchor, Candidate, Frame, Match, Reason
from convseq_ros.errors import MapError
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from world import map_of

pytestmark = pytest.mark.once

ENCODING, SECOND, DAY = EncodingConfig(image_size_px=64), 10**9, 86_400 * 10**9
ROUND = 3 * STRETCH.keyframes


def driven(lights, seed=0, missed=3):
    """Return a map of some rounds, of which only the first frames were not recognised."""
    rng = np.random.default_rng(seed)
    shows = rng.random((ROUND, 4, 4, 8)).astype(np.float16)
    whole = ReferenceMap(ENCODING)
    for day, light in enumerate(lights):
        whole.begin_session(day * DAY)
        lit = np.random.default_rng([9, light]).random((4, 4, 8))
        for at in range(ROUND):
            noise = 0.02 * rng.random((4, 4, 8))
            cells = (shows[at] + 3 * lit + noise).astype(np.float16)
            whole.add(Place(day * DAY + at * SECOND, session=day), cells)
            place = len(whole) - 1
            if day and at >= missed:
                whole.links.add(place, place - ROUND, 0.97, 40)
            else:
                whole.links.add_first(place)
    return whole


@pytest.mark.parametrize('most', [1, 2, 3, 5])
def test_pruning_keeps_a_look_of_each_light_before_a_second_one(most):
    days = [0, 0, 1, 1, 0, 2, 1, 0, 2]
    whole = driven(days)
    out = Pruning(whole, most).surplus
    left = {*range(len(whole))} - {*out}
    assert len(left) == most * ROUND and left >= {*range(ROUND)}
    for at in range(ROUND):
        lights = [light for day, light in enumerate(days) if day * ROUND + at in left]
        assert len(lights) == most and len({*lights}) == min(most, 3)


def test_a_long_drive_whose_rounds_differ_by_noise_alone_keeps_the_first():
    # A round is no multiple of a stretch, so that looks of a place begin elsewhere each time.
    rng, lap, most = np.random.default_rng(3), ROUND + 5, 3
    shows, whole = rng.random((lap, 4, 4, 8)), ReferenceMap(ENCODING)
    for place in range(12 * lap):
        noise = 0.02 * rng.random((4, 4, 8))
        cells = (shows[place % lap] + noise).astype(np.float16)
        whole.add(Place(place * SECOND), cells)
        if place >= lap:
            whole.links.add(place, place - lap, 0.97, 40)
        else:
            whole.links.add_first(place)
    left = {*range(len(whole))} - {*Pruning(whole, most).surplus}
    assert max(left) < most * lap + STRETCH.keyframes and len(left) >= most * ROUND


def test_pruning_removes_nothing_without_a_limit_or_without_links():
    whole = driven([0, 1, 0])
    assert Pruning(whole, 0).surplus == Pruning(whole, 3).surplus == []
    assert Pruning(map_of([np.ones((4, 4, 8))] * 50, ENCODING), 1).surplus == []


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(st.integers(1, 119), st.integers(0, 118)), max_size=150),
    st.lists(st.integers(1, 119), max_size=4),
    st.integers(1, 3),
)
def test_pruning_keeps_anchors_for_any_links(drawn, starts, most):
    whole = ReferenceMap(ENCODING)
    rng = np.random.default_rng(0)
    for index in range(120):
        if index in starts:
            whole.begin_session(index)
        session = max(0, len(whole.sessions) - 1)
        whole.add(Place(index, session=session), rng.random((4, 4, 8)).astype(np.float16))
    for place, other in drawn:
        if other < place:
            whole.links.add(place, other)
    out = Pruning(whole, most).surplus
    assert out == sorted({*out}) and not {*out} & {anchor for _, anchor in whole.links}
    assert not [one for one in out if whole.links.anchor(one) == one and not _beside(whole, one)]


def _beside(whole, place):
    """Return whether something in the same stretch was recognised."""
    start, end = whole.bounds.span(place)
    first, last = place - 2 * STRETCH.keyframes, place + 2 * STRETCH.keyframes
    near = range(max(start, first), min(end, last, 120))
    return any(whole.links.anchor(one) != one for one in near)


def test_pruning_a_file_removes_its_surplus_looks_once_and_keeps_anchors(path):
    whole = driven([0, 0, 1, 1, 0, 2, 1, 0, 2])
    save_map(whole, path)
    before = open_map(path)
    anchors = {_by_stamp(before, anchor) for _, anchor in before.links if anchor < ROUND}
    assert prune_looks(path, 3) == 6 * ROUND
    left = open_map(path)
    assert len(left) == 3 * ROUND and len(left.sessions) == 3 and left.map_id != before.map_id
    assert {one.id for one in left.sessions} <= {one.id for one in before.sessions}
    assert {_by_stamp(left, anchor) for _, anchor in left.links} <= anchors
    # A link past what went says how far that was sure, and leads to what is left.
    assert all(one.confidence == 0.97 for one in left.links.each() if one.place % ROUND >= 3)
    was = path.read_bytes()
    assert prune_looks(path, 3) == 0 and path.read_bytes() == was


def _by_stamp(whole, index):
    place = whole.places[index]
    return whole.sessions[place.session].id, place.stamp_ns


def test_a_removal_that_fails_leaves_the_map_as_it_is(path, monkeypatch):
    save_map(driven([0, 1, 0, 1]), path)
    size = path.stat().st_size
    full = Mock(side_effect=OSError(28, 'No space left on device'))
    monkeypatch.setattr('os.replace', full)
    pipeline = Pipeline(path, make_config({'mode': 'online', 'image_size_px': 64, 'max_looks': 2}))
    assert len(pipeline.recognizer.reference_map) == 4 * ROUND
    with pytest.raises(MapError, match='No space left on device'):
        pipeline.close()
    assert len(open_map(path)) == 4 * ROUND and path.stat().st_size == size


@pytest.mark.parametrize(
    ('reason', 'known'),
    [(Reason.ACCEPTED, 7), (Reason.COOL_DOWN, 7), (Reason.WEAK, None), (Reason.AMBIGUOUS, None)],
)
def test_an_accepted_place_is_known_at_any_confidence(reason, known):
    best = (Candidate(7, 1, 0.25),)
    assert recognised_place(Match(3, 1, reason, best, 2, confidence=0.5)) == known
    assert recognised_place(None) is None


def test_a_map_of_a_path_that_is_driven_repeatedly_stops_growing_and_is_recognised(path, image):
    config = make_config({'mode': 'online', 'image_size_px': 128, 'max_looks': 2})
    for day in range(6):
        pipeline, found = Pipeline(path, config), []
        for place in range(ROUND):
            frame = Frame(day * DAY + place * SECOND, image(place, day))
            found.append(pipeline.recognizer.process(frame))
            pipeline.save()
        pipeline.close()
        known = [(at, one.accepted) for at, one in enumerate(found) if one.accepted]
        right = [one.reference_stamp_ns // SECOND % 86_400 == at for at, one in known]
        assert not day or (all(right) and len(right) > 0.8 * ROUND)
        assert pipeline.added <= (ROUND if day < 2 else 2 * STRETCH.keyframes)
        assert pipeline.owner.committed == len(open_map(path)) <= min(day + 1, 2) * ROUND
    # The anchor of an answer is the same, whatever went, and is what the first drive saw.
    first = open_map(path)
    anchors = [match.anchor for match in found if match.accepted]
    assert {one.session_id for one in anchors[STRETCH.keyframes :]} == {first.sessions[0].id}
    assert all(isinstance(one, Anchor) and one.stamp_ns < 90 * SECOND for one in anchors[20:])


def test_of_a_place_with_looks_enough_nothing_is_added_and_what_is_new_is_at_once(monkeypatch):
    whole, gray = driven([0]), np.zeros((64, 64), np.uint8)
    mapping = OnlineMap(whole, make_config({'mode': 'online', 'image_size_px': 64}))
    monkeypatch.setattr(mapping._pruning, 'has_room', lambda *_: False)
    shown = describe(gray, ENCODING)

    def drive(reason):
        match = Match(0, 1, reason, (Candidate(7, 1, 0.9),), 2)
        mapping.add(Frame(DAY, gray), shown, match)
        return len(whole) - ROUND

    assert {drive(Reason.ACCEPTED) for _ in range(2 * STRETCH.keyframes + 2)} == {0}
    assert drive(Reason.WEAK) == 1


def test_build_map_keeps_every_keyframe_unless_asked(path, tmp_path, image):
    steps = [(day, at) for day in range(3) for at in range(ROUND)]
    frames = [Frame((day * 200 + at) * SECOND, image(at, day)) for day, at in steps]
    config = make_config({'image_size_px': 128, 'max_looks': 1})
    every = build_map(frames, None, config)
    assert len(every) == 3 * ROUND
    with MapBuilder(path, config, max_looks=1) as builder:
        for frame in frames:
            builder.process(frame)
    left = open_map(path)
    assert ROUND <= len(left) < 2 * ROUND
    assert len(left) == len(builder.reference_map) - builder.removed
