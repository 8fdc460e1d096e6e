# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sessions of a map, and what a program does with one."""

from dataclasses import replace
from itertools import pairwise

from convseq_ros.config import Config, KeyframeConfig, make_config
from convseq_ros.core import session
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.linking import link_map
from convseq_ros.core.map.place import Place
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.sessions import MapSession, SessionBounds
from convseq_ros.core.map.writer import save_map
from convseq_ros.core.map_builder import build_map
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.sequence.diagonals import sequence_scores
from convseq_ros.core.session import Session
from convseq_ros.core.types import Frame, LocalizationState, Pose
from convseq_ros.errors import MapError
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

AHEAD = (0.0, 0.0, 0.0, 1.0)
CELLS = np.ones((32, 32, 8), np.float16)


def a_map(*lengths, step_m=1.0):
    """Return a map of sessions of some places, one after another, each from x = 0."""
    reference_map = ReferenceMap()
    for number, length in enumerate(lengths):
        reference_map.sessions.append(MapSession(f'id {number}', '', number))
        for index in range(length):
            pose = Pose((index * step_m, 0.0, 0.0), AHEAD)
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


def test_two_drives_of_one_way_answer_as_one_and_say_which(image):
    def drive(seed, start_ns):
        return [Frame(start_ns + index * 10**9, image(index, seed)) for index in range(40)]

    reference_map = ReferenceMap()
    for number in (1, 2):
        reference_map.begin_session(number * 10**12)
        for frame in drive(number, number * 10**12):
            reference_map.add_frame(frame, describe(frame.gray))
    assert len([*link_map(reference_map)]) == 80 and len(reference_map.links) > 30
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


def test_a_map_of_other_keyframes_than_asked_for_is_used_and_says_so(tmp_path):
    path = tmp_path / 'map.db'
    made = KeyframeConfig(keyframe_interval_s=0.5)
    frames = [Frame(index * 10**9, np.full((48, 64), index, np.uint8)) for index in range(3)]
    build_map(frames, path, Config(keyframes=replace(made, keyframe_overlap=1.0)))
    assert Session(path, Config()).ignored == []
    other = Session(path, Config(keyframes=replace(made, keyframe_interval_s=2.0)))
    assert other.ignored == [
        f'keyframe_interval_s 2.0 is ignored: {path} was made with 0.5; build the map again to '
        'change it'
    ]


@pytest.mark.parametrize(('kernel', 'said'), [('auto', 'install gcc'), ('numpy', '')])
def test_a_slow_session_says_why_unless_it_was_asked_for(monkeypatch, kernel, said):
    monkeypatch.setattr(session, 'slow_path', lambda: 'no compiled kernels: install gcc')
    made = Session(None, make_config({'mode': 'online', 'kernel': kernel}))
    assert made.slow == (f'no compiled kernels: {said}' if said else '')
