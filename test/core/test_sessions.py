# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sessions of a map, and what a program does with one."""

from dataclasses import replace

from convseq_ros.config import Config, KeyframeConfig, make_config
from convseq_ros.core import session
from convseq_ros.core.map.place import Place
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.sessions import MapSession
from convseq_ros.core.map.writer import save_map
from convseq_ros.core.map_builder import build_map
from convseq_ros.core.session import Session
from convseq_ros.core.types import Frame, Pose
from convseq_ros.errors import MapError
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
