# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A growing map is persisted in its file."""

import os
import signal
import subprocess
import sys

from convseq_ros.config import EncodingConfig
from convseq_ros.core.map.online import Autosave
from convseq_ros.core.map.place import pack_cells, Place
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.writer import save_map
from convseq_ros.errors import MapError
import numpy as np
import pytest

ENCODING = EncodingConfig(image_size_px=64)
SECOND = 10**9


def cells(seed):
    return pack_cells(np.random.default_rng(seed).random((4, 4, 8), np.float32) * 1000)


def grow(reference_map, count):
    for index in range(len(reference_map), len(reference_map) + count):
        reference_map.add(Place(index), cells(index), b'%d' % index)


def grown(count):
    reference_map = ReferenceMap(ENCODING)
    grow(reference_map, count)
    return reference_map


def holds(path, count):
    opened = open_map(path, ENCODING)
    return len(opened) == count and all(
        (opened.packed(index) == cells(index)).all() and opened.thumbnail(index) == b'%d' % index
        for index in range(count)
    )


@pytest.fixture
def path(tmp_path):
    return tmp_path / 'map.db'


def test_a_map_that_starts_empty_is_persisted_in_a_new_file(path):
    reference_map = grown(0)
    autosave = Autosave(path, reference_map)
    assert holds(path, 0)
    grow(reference_map, 3)
    autosave.close()
    assert holds(path, 3)


def test_what_is_there_is_written_at_once_to_a_new_file(path):
    autosave = Autosave(path, grown(4))
    assert holds(path, 4)
    autosave.close()


def test_the_file_that_was_opened_goes_on_growing(path):
    save_map(grown(3), path)
    reference_map = open_map(path)
    autosave = Autosave(path, reference_map)
    grow(reference_map, 2)
    autosave.close()
    assert holds(path, 5)


def test_places_are_safe_every_half_second(path):
    reference_map, start = grown(0), 5 * SECOND
    autosave = Autosave(path, reference_map)
    autosave.save(start)
    for now_ns, safe in ((0.1, 0), (0.49, 0), (0.5, 3), (0.9, 3), (1.0, 5)):
        grow(reference_map, 1)
        autosave.save(start + round(now_ns * SECOND))
        assert len(open_map(path)) == safe
    autosave.close()


def test_a_clock_is_found_where_none_is_given(path):
    autosave = Autosave(path, grown(0))
    autosave.save()
    autosave.close()


def test_what_is_persisted_is_evicted_and_still_known(path):
    reference_map = grown(0)
    autosave = Autosave(path, reference_map)
    for frame in range(30):
        grow(reference_map, 1)
        autosave.save((frame + 1) * 10**15)
        assert not reference_map._in_memory
    assert all((reference_map.packed(index) == cells(index)).all() for index in range(30))
    autosave.close()
    assert (reference_map.packed(7) == cells(7)).all()


def test_another_map_is_not_mixed_in(path):
    save_map(grown(3), path)
    before = path.read_bytes()
    other = ReferenceMap(ENCODING)
    for index in range(3):
        other.add(Place(index), cells(index + 50))
    for one in (other, grown(2), grown(0)):
        with pytest.raises(MapError, match=r'map.db: holds another map .*name a new file'):
            Autosave(path, one)
    assert path.read_bytes() == before


def test_a_file_that_is_no_map_is_left_alone(path):
    path.write_bytes(b'SQLite format 3\0' + b'\0' * 500)
    with pytest.raises(MapError):
        Autosave(path, grown(1))
    assert path.stat().st_size == 516


@pytest.mark.parametrize('what', ['folder', 'file'])
def test_where_nothing_can_be_written_is_said_at_the_start(path, what, monkeypatch):
    save_map(grown(2), path)
    blocked = path if what == 'file' else path.parent
    monkeypatch.setattr(os, 'access', lambda one, _mode: os.fspath(one) != os.fspath(blocked))
    with pytest.raises(MapError, match=r'map.db: cannot be written; make it and its folder'):
        Autosave(path, open_map(path))


def test_a_missing_folder_is_said_at_the_start(tmp_path):
    with pytest.raises(MapError, match=r'there is no folder .*/none; make it'):
        Autosave(tmp_path / 'none' / 'map.db', grown(0))


def test_a_full_disk_is_reported_once_and_the_rest_is_written_when_there_is_room(path):
    reference_map = grown(0)
    autosave = Autosave(path, reference_map)
    grow(reference_map, 1)
    autosave.save(10**15)
    database = autosave._writer._database
    database.execute('PRAGMA max_page_count = 6')
    grow(reference_map, 40)
    with pytest.raises(MapError, match=r'map.db: cannot write .*disk full'):
        autosave.save(2 * 10**15)
    autosave.save(3 * 10**15)
    assert holds(path, 1) and (reference_map.packed(40) == cells(40)).all()
    database.execute('PRAGMA max_page_count = 1000000')
    autosave.save(4 * 10**15)
    assert holds(path, 41)
    database.execute('PRAGMA max_page_count = 6')
    grow(reference_map, 40)
    with pytest.raises(MapError, match='disk full'):
        autosave.close()


def test_a_second_program_that_adds_to_the_map_is_told_so(path):
    save_map(grown(3), path)
    maps = [open_map(path) for _ in range(2)]
    first, second = (Autosave(path, one) for one in maps)
    grow(maps[0], 1)
    first.close()
    grow(maps[1], 2)
    with pytest.raises(MapError, match=r'map.db: another program adds to this map .*only one'):
        second.save(10**15)
    with pytest.raises(MapError, match='another program'):
        second.close()
    assert holds(path, 4)


def test_a_file_that_was_replaced_is_reported_and_left_alone(path):
    reference_map = grown(1)
    autosave = Autosave(path, reference_map)
    save_map(reference_map, path)
    before = path.read_bytes()
    grow(reference_map, 1)
    with pytest.raises(MapError, match=r'map.db: was moved or replaced'):
        autosave.save(10**15)
    autosave.save(2 * 10**15)
    assert path.read_bytes() == before and (reference_map.packed(0) == cells(0)).all()


SAVE_UNTIL_KILLED = """
import sys
from pathlib import Path
sys.path.insert(0, {folder!r})
from test_autosave import Autosave, grow, grown
reference_map = grown(0)
autosave = Autosave(Path({path!r}), reference_map)
now_ns = 10**15
while True:
    grow(reference_map, 5)
    now_ns += 10**9
    autosave.save(now_ns)
    print(len(reference_map), flush=True)
"""


def test_what_was_committed_outlives_being_killed_at_any_moment(path):
    program = SAVE_UNTIL_KILLED.format(folder=os.path.dirname(__file__), path=str(path))
    with subprocess.Popen(
        [sys.executable, '-c', program], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as process:
        for _ in range(40):
            committed = int(process.stdout.readline())
        process.send_signal(signal.SIGKILL)
        for line in process.stdout:
            committed = int(line)
    left = path.read_bytes()
    count = len(open_map(path))
    assert committed <= count <= committed + 5 and holds(path, count)
    assert path.read_bytes() == left
    reference_map = open_map(path)
    autosave = Autosave(path, reference_map)
    grow(reference_map, 3)
    autosave.close()
    assert holds(path, count + 3)
