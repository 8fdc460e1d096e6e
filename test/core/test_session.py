# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A session is ready when it has warmed up, and says which settings it cannot follow."""

from dataclasses import replace

from convseq_ros.config import Config, KeyframeConfig, make_config
from convseq_ros.core import session
from convseq_ros.core.map_builder import build_map
from convseq_ros.core.session import Session
from convseq_ros.core.types import Frame
import numpy as np
import pytest


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
