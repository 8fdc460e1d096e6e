# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The file of a map in use is cut short or overwritten in place: it is left alone, and named."""

import os

from convseq_ros.app.pipeline import Pipeline
from convseq_ros.config import make_config
from convseq_ros.core.map.online import RECENT
from convseq_ros.core.map.place import Place
from convseq_ros.core.map.writer import save_map
from convseq_ros.core.types import Frame
from convseq_ros.errors import MapError
from pictures import walls
import pytest

from bench.torture.maps import drawn

SECOND = 1_000_000_000
PAST = 20  # places that may be matched after the first drive
PLACES = PAST + RECENT.keyframes + 1
SETTINGS = {
    'matching': 'regional', 'search': 'exhaustive', 'image_size_px': 128,
    'fixed_length': 1, 'keyframe_overlap': 1.0, 'rival_distance': 1,
}  # fmt: skip


@pytest.fixture
def drive(tmp_path):
    """Return a pipeline whose map holds 41 places in its file, and what answers a place."""
    images, frames = walls(PLACES), [0]
    growing = Pipeline(tmp_path / 'map.db', make_config({**SETTINGS, 'mode': 'online'}))

    def answer(pipeline, place):
        frames[0] += 1
        match = pipeline.cameras.process(Frame(frames[0] * SECOND, images[place]))
        return match.accepted and match.accepted.reference_index

    for place in range(PLACES):
        answer(growing, place)
    growing.flush()
    return growing, answer


@pytest.mark.parametrize(
    'harm',
    [
        lambda was, _: was[: len(was) // 2],
        lambda *_: b'',
        lambda was, _: bytes(len(was)),
        lambda _, other: other,
    ],
    ids=['cut short', 'empty', 'overwritten', 'another map'],
)
def test_a_growing_map_grows_no_more_and_leaves_the_file_alone(drive, tmp_path, harm):
    growing, answer = drive
    whole = growing.recognizer.reference_map
    assert answer(growing, 0) == 0
    growing.flush()
    save_map(drawn(400), tmp_path / 'other.db')
    harmed = harm(growing.path.read_bytes(), (tmp_path / 'other.db').read_bytes())
    cells = whole.packed(0)
    growing.path.write_bytes(harmed)
    whole.add(Place(10**6 * SECOND), cells)
    with pytest.raises(MapError, match='was cut short or overwritten') as told:
        growing.flush()
    assert '\n' not in str(told.value) and 'restore the file' in str(told.value)
    with pytest.raises(MapError):
        growing.save()
    growing.save()
    count = len(whole)
    with pytest.raises(MapError, match=r'map\.db: .*; '):  # what is read names file and remedy
        whole.pictures(range(PLACES))
    assert len(whole) == count
    with pytest.raises(MapError):
        growing.close()
    assert growing.path.read_bytes() == harmed


def test_a_command_ends_at_a_map_that_is_cut_short(drive):
    growing, answer = drive
    growing.close()
    loaded = Pipeline(growing.path, make_config(SETTINGS))
    os.truncate(loaded.path, loaded.path.stat().st_size // 2)
    with pytest.raises(MapError, match='damaged map'):
        for place in range(PLACES):
            answer(loaded, place)
