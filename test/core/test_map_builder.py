# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps made offline are those made online, of the same frames."""

from dataclasses import replace
from pathlib import Path
import sqlite3

from convseq_ros.app.map_builder import build_map, MapBuilder
from convseq_ros.app.pipeline import Pipeline
from convseq_ros.config import make_config
from convseq_ros.core.decision.belief_decider import BeliefDecider
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.writer import save_map
from convseq_ros.core.types import Frame
from convseq_ros.errors import MapError
import numpy as np
from poses import at
import pytest

pytestmark = pytest.mark.once

SECOND = 1_000_000_000
SMALL = make_config({'image_size_px': 128})
SETTINGS = {
    'by scene': {},
    'every frame': {'keyframe_overlap': 1.0},
    'every frame, as in the paper': {'keyframe_overlap': 1.0, 'matching': 'regional'},
    'by time': {'keyframe_interval_s': 4.0, 'keyframe_overlap': 1.0},
    'by time and distance': {'keyframe_interval_s': 2.0, 'keyframe_distance_m': 1.5},
}


def drive(image) -> list[Frame]:
    """Return a drive that stands, creeps, is dark, is unreadable; half of it has poses."""
    places = [0, 1, 2, 2, 2, 2, 3, 3, 4, 5, 6, 7, 8, 8, 9, 10, 11, 12]
    poses = [None] * 9 + [at(0.8 * place) for place in places[9:]]
    shown = [image(place, seed=index) for index, place in enumerate(places)]
    frames = [Frame(n * SECOND, shown[n], 'camera', pose=poses[n]) for n in range(len(places))]
    frames[8] = replace(frames[8], gray=None, problem='cut short')
    frames[10] = replace(frames[10], gray=np.zeros_like(frames[0].gray))
    return frames


def dump(path: Path) -> list[str]:
    """Return all that a map holds, but for the ids of the map and its session."""
    with sqlite3.connect(path) as database:
        database.execute("DELETE FROM about WHERE name = 'map_id'")
        database.execute('UPDATE sessions SET id = 0, crc32 = 0')
        found = list(database.iterdump())
        database.rollback()
        return found


@pytest.mark.parametrize('settings', SETTINGS.values(), ids=SETTINGS)
def test_online_and_offline_make_the_same_map(tmp_path, image, settings):
    config = make_config({'image_size_px': 128, 'mode': 'online', **settings})
    offline, online = tmp_path / 'offline.db', tmp_path / 'online.db'
    build_map(drive(image), offline, config)
    pipeline = Pipeline(online, config)
    for frame in drive(image):
        pipeline.recognizer.process(frame)
        pipeline.save()
    pipeline.close()
    assert dump(offline) == dump(online)
    assert 3 < len(open_map(offline)) < len(drive(image))


@pytest.mark.parametrize(('links', 'shares'), [(True, 1), (False, 0)])
def test_links_cost_one_recognised_frame_a_keyframe_at_most(image, monkeypatch, links, shares):
    asked, decide = [], BeliefDecider.decide

    def counted(self, query):
        asked.append(query.frame.stamp_ns)
        return decide(self, query)

    monkeypatch.setattr(BeliefDecider, 'decide', counted)
    # Each place twice, two rounds.
    frames = [Frame(step * SECOND, image(step // 2 % 20)) for step in range(80)]
    made = build_map(frames, None, SMALL, links=links)
    stamps = [place.stamp_ns for place in made.places]
    assert len(stamps) <= 40 and {*asked} <= {*stamps}
    assert len(asked) <= shares * len(stamps) and bool(asked) == links


def test_a_finished_map_survives_when_nothing_can_be_added(path, image):
    build_map(drive(image), path, SMALL)
    before = dump(path)
    with MapBuilder(path, SMALL, append=True) as builder:
        builder.process(Frame(0, None))
    assert builder.added == 0 and dump(path) == before


def test_a_map_that_is_there_is_not_replaced(path, tmp_path, image):
    build_map(drive(image), path, SMALL)
    before = dump(path)
    with pytest.raises(MapError, match='exists already'):
        build_map(drive(image), path, SMALL)
    with pytest.raises(MapError, match='no such map to add to; make one with'):
        MapBuilder(tmp_path / 'none.db', SMALL, append=True)
    assert dump(path) == before


def test_a_builder_that_ends_without_a_place_deletes_nothing_of_another(path, image):
    with MapBuilder(path, SMALL) as first:
        first.process(Frame(0, None))
        with pytest.raises(MapError, match=r'map.db: another program adds to this map'):
            with MapBuilder(path, SMALL, append=True) as second:
                second.process(drive(image)[0])
    assert not path.exists()
    build_map(drive(image), path, SMALL)
    before = dump(path)
    for append in (True, False):
        with pytest.raises((RuntimeError, MapError)):
            with MapBuilder(path, SMALL, append=append):
                raise RuntimeError
        assert dump(path) == before


@pytest.mark.parametrize('left', ['an empty file', 'a map without places'])
def test_a_map_can_be_built_where_a_crash_left_none(path, image, left):
    path.touch()
    if left != 'an empty file':
        save_map(ReferenceMap(), path)
    made = len(build_map(drive(image), path, SMALL))
    assert len(open_map(path, SMALL.encoding)) == made > 3
