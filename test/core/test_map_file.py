# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The map file: round trips, and files that must be refused; bench/torture has the crashes."""

from contextlib import closing
import json
import shutil
import sqlite3

from convseq_ros.config import KeyframeConfig
from convseq_ros.core.map import reader
from convseq_ros.core.map.database import Database
from convseq_ros.core.map.format import FORMAT_VERSION, is_map_or_empty
from convseq_ros.core.map.place import Picture, Place, unpack_cells
from convseq_ros.core.map.reader import MapReader, open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.session_slice import joined, slices_of
from convseq_ros.core.map.writer import MapWriter, save_map
from convseq_ros.core.types import Camera, Pose
from convseq_ros.errors import MapError
import numpy as np
from programs import open_files
import pytest

from bench.torture.maps import APART, cells, drawn, ENCODING


def made():
    whole = drawn(5)
    whole.add(Place(10**18 + 1, 'a.jpg', Pose((0.1, 0, 0), (0, 0, 0, 1))), cells(5))
    return whole


@pytest.fixture
def map_path(path):
    save_map(made(), path)
    return path


def same(one, other):
    return list(one.places) == list(other.places) and all(
        (one.packed(index) == other.packed(index)).all()
        and one.thumbnail(index) == other.thumbnail(index)
        and (one.global_descriptors[index] == other.global_descriptors[index]).all()
        for index in range(len(one))
    )


def test_cells_of_another_size_are_refused():
    with pytest.raises(ValueError, match='expected'):
        ReferenceMap().add(Place(0), cells(0))


def test_a_saved_map_is_opened_unchanged(map_path):
    assert same(open_map(map_path, ENCODING), made())


def test_a_map_keeps_its_id_and_all_that_is_known_of_its_sessions(path):
    whole, mount = ReferenceMap(ENCODING), Pose((0, 0, 1), (0, 0, 0, 1))
    camera = Camera(640, 480, 500.0, 400.0, 0.0, 240.0, 'plumb_bob', (0.0, 0.1, 0.0, 0.0), mount)
    for known in ((), (camera, 'lap', 'town'), (Camera(1, 1, 1.0, 1.0, 1.0, 1.0),)):
        whole.begin_session(len(whole), *known)
        whole.add(Place(len(whole), session=len(whole.sessions) - 1), cells(0))
    whole.position_sigma_m = 1.25
    save_map(whole, path)
    opened = open_map(path)
    assert opened.sessions == whole.sessions and opened.map_id == whole.map_id
    assert opened.position_sigma_m == 1.25
    assert joined(slices_of(path)).position_sigma_m == 1.25  # each edit joins slices anew


def test_a_place_that_is_written_before_any_session_begins_one(path):
    with MapWriter(path, ENCODING, APART) as writer:
        writer.add(Place(7), Picture(cells(0)), drawn(1).global_descriptors[0])
    assert [session.start_ns for session in open_map(path).sessions] == [7]


def test_a_map_is_whole_however_many_rows_are_read_at_once(map_path, monkeypatch):
    for count in (1, 2, 3):
        monkeypatch.setattr(reader, '_ROWS_AT_ONCE', count)
        assert same(open_map(map_path), made())
        assert MapReader(map_path).about()['thumbnails'] == 5


def test_a_change_of_a_file_that_is_broken_off_changes_nothing(map_path):
    def change_half():
        with closing(Database(map_path, 'rw')) as database, database.transaction('IMMEDIATE'):
            database.rows('DELETE FROM places')
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        change_half()
    assert same(open_map(map_path), made())


def test_a_map_knows_how_far_apart_its_places_are(path):
    apart = KeyframeConfig(keyframe_interval_s=0.5)
    save_map(ReferenceMap(ENCODING, keyframes=apart), path)
    assert open_map(path).keyframes.spacing == apart.spacing
    assert open_map(path, ENCODING, apart).keyframes == apart
    with pytest.raises(MapError, match=r'interval_s 0.5, asked for 0.0; set keyframe_interval_s'):
        open_map(path, ENCODING, KeyframeConfig())
    with pytest.raises(MapError, match=r'keyframe_interval_s 0.5, asked for 2'):
        MapWriter(path, ENCODING, KeyframeConfig(keyframe_interval_s=2), append=True)


def test_opening_does_not_change_the_file(map_path):
    before = map_path.read_bytes(), map_path.stat().st_mtime_ns
    map_path.chmod(0o444)
    open_map(map_path)
    MapReader(map_path).about()
    assert (map_path.read_bytes(), map_path.stat().st_mtime_ns) == before
    assert list(map_path.parent.iterdir()) == [map_path]


def test_the_file_names_its_tool_and_settings(map_path):
    about = MapReader(map_path).about()
    settings = {'image_size_px': 64, 'resize': 'exact', 'image_mask': '', 'image_rotation_deg': 0}
    assert json.loads(about['encoding']) == settings
    assert about['tool'] and (about['thumbnails'], about['images']) == (5, 0)


@pytest.mark.parametrize(
    ('version', 'remedy'), [(7, 'build the map again'), (FORMAT_VERSION + 1, 'update conv')]
)
def test_another_format_is_refused_with_both_versions_and_the_remedy(map_path, version, remedy):
    with sqlite3.connect(map_path) as database:
        database.execute(f'PRAGMA user_version = {version}')
    line = f'map format {version}, this program reads {FORMAT_VERSION}; {remedy}'
    for use in (open_map, lambda path: MapWriter(path, ENCODING, APART, append=True)):
        with pytest.raises(MapError, match=line):
            use(map_path)


def test_only_a_map_or_an_empty_file_may_be_replaced(map_path, tmp_path):
    empty, text, other = (tmp_path / name for name in ('empty', 'text', 'other.db'))
    empty.touch()
    text.write_text('a diary\n' * 20)
    with closing(sqlite3.connect(other)) as database:
        database.execute('CREATE TABLE diary (day)')
    assert is_map_or_empty(map_path) and is_map_or_empty(empty)
    assert not is_map_or_empty(text) and not is_map_or_empty(other)


NO_MAPS = {
    'empty.db': (b'', 'is empty, no map yet; make one with'),
    'text.db': (b'not a map', 'not a convseq map'),
    'zeros.db': (b'SQLite format 3\0' + b'\0' * 500, 'not a convseq map'),
    'other.db': ('CREATE TABLE frames (x)', 'another SQLite file'),
    'none.db': (None, 'no such map; make one with `convseq build-map'),
    '.': (None, 'is a folder; name the map file in it'),
}


@pytest.mark.parametrize('name', NO_MAPS)
def test_what_is_no_map_is_refused_with_the_remedy_and_stays(tmp_path, name):
    content, told = NO_MAPS[name]
    path = tmp_path / name
    if isinstance(content, str):
        with closing(sqlite3.connect(path)) as database:
            database.execute(content)
    elif content is not None:
        path.write_bytes(content)
    before = path.is_file() and path.read_bytes()
    for _ in range(3):
        with pytest.raises(MapError, match=told):
            open_map(path)
    assert not open_files(path)
    assert before == (path.is_file() and path.read_bytes())


@pytest.mark.parametrize('index', [0, 2, 4])
@pytest.mark.parametrize('table', ['places', 'pictures'])
def test_a_lost_row_is_found(map_path, table, index):
    with sqlite3.connect(map_path) as database:
        database.execute(f'DELETE FROM {table} WHERE reference_index = {index}')
    with pytest.raises(MapError, match=rf'reference {index} (is missing|fails its checksum)'):
        open_map(map_path).packed(index)


@pytest.mark.parametrize('count', [300, 40_000])
def test_many_places_are_read_in_the_requested_order(map_path, count):
    indices = np.random.default_rng(0).integers(0, 5, count)
    found = open_map(map_path).packed_of(indices.tolist())
    assert np.array_equal(found, np.array([cells(index) for index in range(5)])[indices])


@pytest.mark.parametrize('damage', ['DELETE FROM pictures', 'UPDATE pictures SET crc32 = 1'])
def test_one_bad_place_among_many_is_found_when_they_are_read(map_path, damage):
    opened = open_map(map_path)
    with sqlite3.connect(map_path) as database:
        database.execute(f'{damage} WHERE reference_index = 3')
    with pytest.raises(MapError, match=r'reference 3 (is missing|fails its checksum)'):
        opened.packed_of([0, 3, 1])
    assert len(opened.packed_of([0, 1])) == 2


def test_a_map_that_another_one_is_copied_over_is_not_mixed_with_it(map_path, tmp_path):
    opened, other = open_map(map_path), tmp_path / 'other.db'
    save_map(made(), other)
    shutil.copyfile(other, map_path)  # which keeps the file, as `cp` does
    with pytest.raises(MapError, match='was overwritten by another map; load it again'):
        opened.packed(0)


def test_unpacked_cells_are_64_times_the_packed_ones():
    halves = np.arange(1 << 16, dtype=np.uint16).view(np.float16)
    packed = halves[np.isfinite(halves)]
    assert unpack_cells(packed).tobytes() == (packed.astype(np.float32) * 64).tobytes()
    assert unpack_cells(packed[: 16 * 8].reshape(4, 4, 8)).shape == (4, 4, 8)
