# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A map from a stranger, or a bad disk: refused in one line, and nothing in it is executed."""

from contextlib import closing
from io import BytesIO
import os
import signal
import sqlite3
import time
from unittest.mock import Mock

from convseq_ros.core.map import crash_recovery
from convseq_ros.core.map import database as limits
from convseq_ros.core.map.appender import Appender
from convseq_ros.core.map.crash_recovery import _checksum, _damaged_at
from convseq_ros.core.map.database import as_map_error, Database
from convseq_ros.core.map.edit import unlink
from convseq_ros.core.map.format import PAGE_BYTES, row_crc, Settings
from convseq_ros.core.map.lock import MapLock
from convseq_ros.core.map.place import Place
from convseq_ros.core.map.reader import MapReader, open_map
from convseq_ros.core.map.writer import MapWriter, save_map
from convseq_ros.core.types import Pose
from convseq_ros.errors import MapError
import numpy as np
import pytest

from bench.torture.maps import APART, cells, crash, drawn, ENCODING, holds, log_of

pytestmark = pytest.mark.once

ENDLESS = 'WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x FROM c) SELECT'


@pytest.fixture
def path(path):
    save_map(drawn(20), path)
    return path


def test_a_loop_of_links_is_no_map(path):
    path.unlink()
    path.symlink_to(path)
    assert refusal(MapLock, path)


def refusal(function, *args, **kwargs):
    with pytest.raises(MapError) as found:
        function(*args, **kwargs)
    assert str(found.value).isprintable() and 'map.db: ' in str(found.value)
    return str(found.value)


def rewrite(path, table, column, value, which='reference_index = 7'):
    """Change a value of a row, and its checksum with it."""
    with closing(sqlite3.connect(path)) as database, database:
        database.execute(f'UPDATE {table} SET {column} = ? WHERE {which}', (value,))
        (row,) = database.execute(f'SELECT * FROM {table} WHERE {which}')
        database.execute(f'UPDATE {table} SET crc32 = ? WHERE {which}', (row_crc(row[:-1]),))


def pooled(number):
    """Return a descriptor with one number that no map has."""
    numbers = np.array(drawn(20).global_descriptors[7])
    numbers[3] = number
    return 'places', 'pooled', numbers.tobytes()


def far(index):
    """Return what moves the last place so far away that memory would not do."""
    tables = 'places', 'pictures', 'images'
    return ';'.join(f'UPDATE {one} SET reference_index = {index} {LAST}' for one in tables)


LAST = 'WHERE reference_index = 19'
SETTINGS = 'map_id', 'encoding', 'keyframes'
OF_ENCODING = "name = 'encoding'"
MASKED = '{"image_size_px": 64, "resize": "exact", "image_mask": %s, "image_rotation_deg": 0}'
MASKS = '"#0000"', '"#ff"', '"#zz"', '"/etc/hostname"', '7'
MODELS = '"", "descriptor_model": "/etc/net.onnx"', '"", "descriptor_model": 7'
DAMAGE = [  # SQL, or the value of a row whose checksum suits it; and what is said of it
    ('CREATE TRIGGER own AFTER INSERT ON places BEGIN DELETE FROM places; END', ''),
    (f'CREATE VIEW own AS {ENDLESS} * FROM c', ''),
    ('CREATE TABLE "\n\x1b[2Jown\x7f" (x)', ''),
    ('CREATE INDEX own ON places (stamp_ns)', ''),
    ('ALTER TABLE pictures ADD COLUMN own INTEGER DEFAULT 7', ''),
    *((far(index), f'{index + 1} places in ') for index in (10**6, 2**31, 2**62)),
    *((pooled(one), 'reference 7 has NaN or infinity') for one in (np.nan, np.inf, -np.inf)),
    (('about', 'value', '[' * 100_000, OF_ENCODING), ''),
    (('about', 'value', '7', OF_ENCODING), ''),
    *((('about', 'value', MASKED % mask, OF_ENCODING), '') for mask in MASKS + MODELS),
    (('about', 'value', 'x' * 101, "name = 'map_id'"), ''),
    (('about', 'value', b'1.0.0', "name = 'tool'"), ''),
    (('about', 'name', b'tool', 'length(name) = 4'), ''),
    (('sessions', 'id', 'x' * 101, 'session = 0'), ''),
    (('sessions', 'camera', '{', 'session = 0'), ''),
    (('sessions', 'camera', '{"a": 1}', 'session = 0'), ''),
    *((f"DELETE FROM about WHERE name = '{one}'", f"settings: '{one}'") for one in SETTINGS),
    ('DELETE FROM sessions', 'reference 0 belongs to no session'),
    ("UPDATE sessions SET name = 'x'", 'sessions fails its checksum'),
    (f'DELETE FROM images {LAST}', 'reference 19 is missing'),
]


@pytest.mark.parametrize('told', ['nan', 'inf', '-1', 'x'])
def test_how_well_positions_are_known_is_a_finite_number(told):
    rows = Settings('map', ENCODING, APART, 2.5).rows
    assert Settings.from_rows(rows).position_sigma_m == 2.5
    with pytest.raises(ValueError, match=r'position_sigma_m|could not convert'):
        Settings.from_rows(rows | {'position_sigma_m': told})


@pytest.mark.parametrize(('damage', 'told'), DAMAGE)
def test_a_damaged_or_hostile_map_is_refused_before_it_is_used(path, damage, told):
    if isinstance(damage, str):
        with closing(sqlite3.connect(path)) as database:
            database.executescript(damage)
    else:
        rewrite(path, *damage)
    before = path.read_bytes()
    said = refusal(open_map, path)
    assert 'damaged map (' in said and told in said
    if ' own' in str(damage):
        assert refusal(MapWriter, path, ENCODING, APART, append=True) == said
    assert path.read_bytes() == before


def test_a_statement_that_never_ends_is_ended(path, monkeypatch):
    database = Database(path, 'ro')
    # A long one is not.
    assert database.number(f'{ENDLESS} count(*) FROM (SELECT 1 FROM c LIMIT 50000)') == 50_000
    monkeypatch.setattr(limits, '_LIMIT_S', 0.05)
    with pytest.raises(MapError, match=r'map.db: damaged map \(a statement took more than'):
        with as_map_error(path):
            database.rows(f'{ENDLESS} count(*) FROM c')
    assert database.number('SELECT count(*) FROM places') == 20
    database.close()


def test_a_row_that_declares_more_than_there_is_memory_for_is_damage(path):
    database = sqlite3.connect(path, isolation_level=None)
    database.execute('PRAGMA page_size = 512')
    database.execute('VACUUM')
    database.close()
    content = bytearray(path.read_bytes())
    at = content.index(b'tool') - 5  # the length of a row of `about`, and of its parts
    content[at : at + 7] = 7 * b'\xff'
    path.write_bytes(content)
    with pytest.raises(MapError, match='damaged map'):
        open_map(path)


@pytest.mark.parametrize('number', [np.nan, np.inf, -np.inf, -1.0, -0.0])
def test_cells_that_are_not_finite_are_found_when_they_are_read(path, number):
    packed = cells(7)
    packed[1, 2, 3] = number
    rewrite(path, 'pictures', 'cells', packed.tobytes())
    opened = open_map(path)
    assert 'its cells are not finite, or negative' in refusal(opened.packed, 7)
    assert (opened.packed(8) == cells(8)).all()


@pytest.mark.parametrize(
    ('table', 'column', 'value'),
    [
        ('pictures', 'keypoints', bytes(1001 * 34)),
        ('pictures', 'thumbnail', 'text'),
        ('images', 'jpeg', 7),
        ('images', 'jpeg', 'text'),
    ],
)
def test_what_a_place_keeps_has_its_type_and_at_most_1000_keypoints(path, table, column, value):
    rewrite(path, table, column, value)
    said = refusal(open_map(path).pictures, [7], with_images=True)
    assert 'the thumbnail, keypoints or image of reference 7' in said
    if column == 'keypoints':
        rewrite(path, table, column, bytes(1000 * 34))
        assert len(open_map(path).keypoints(7)) == 1000


@pytest.mark.parametrize('number', [-0.0, np.nan, np.inf, 1e300])
def test_a_map_opens_with_any_odometry_pose_and_leaves_invalid_ones_out(path, number):
    reference_map = drawn(2)
    for numbers in ((number, 0, 0, 0, 0, 0, 1), (0, 0, 0, 0, 0, number, 1)):
        pose = Pose(numbers[:3], numbers[3:])
        reference_map.add(Place(9, pose=pose), cells(9))
    save_map(reference_map, path)
    opened = open_map(path)
    known = number in (0, 1e300)
    assert [place.pose is not None for place in opened.places] == [False, True, known, known]


def test_a_map_whose_sessions_are_mixed_is_refused(path):
    mixed = drawn(3)
    mixed.begin_session(1)
    for session in (1, 0):
        mixed.add(Place(9, session=session), cells(9))
    save_map(mixed, path)
    assert 'places of a session are not adjacent' in refusal(open_map, path)


HOT = 'PRAGMA cache_size = 1', 'BEGIN', 'UPDATE pictures SET thumbnail = zeroblob(9000)'


@pytest.fixture
def crashed(path):
    """Return a map in the state in which a crash in the middle of a commit leaves it."""
    whole, database = path.read_bytes(), sqlite3.connect(path, isolation_level=None)
    for statement in HOT:
        database.execute(statement)
    torn = path.read_bytes(), path.with_name('map.db-journal').read_bytes()
    database.execute('ROLLBACK')
    database.close()
    assert torn[0] != whole
    path.write_bytes(torn[0])
    path.with_name('map.db-journal').write_bytes(torn[1])
    return path


def test_a_journal_that_a_crash_left_is_rolled_back(crashed):
    assert holds(crashed) == 20
    with MapWriter(crashed, ENCODING, APART, append=True) as writer:
        assert writer.committed == 20
    assert list(crashed.parent.iterdir()) == [crashed]


def test_the_journal_of_the_old_map_does_not_spoil_the_one_that_replaces_it(crashed):
    save_map(drawn(30), crashed)
    assert holds(crashed) == 30
    assert list(crashed.parent.iterdir()) == [crashed]


def test_the_old_map_is_mended_before_its_journal_goes(crashed, monkeypatch):
    full = Mock(side_effect=OSError(28, 'No space left on device'))
    monkeypatch.setattr('os.replace', full)
    with pytest.raises(MapError, match='No space left on device'):
        save_map(drawn(30), crashed)
    assert holds(crashed) == 20 and not crashed.with_name('map.db-journal').exists()


def test_a_map_that_is_replaced_during_its_copy_is_read_anew(crashed, monkeypatch):
    """Another program mends the map, and replaces it, while its journal is copied."""
    copy = crash_recovery.shutil.copyfile

    def copy_slowly(source, target):
        monkeypatch.setattr(crash_recovery.shutil, 'copyfile', copy)
        found = copy(source, target)
        save_map(drawn(30), crashed)
        return found

    monkeypatch.setattr(crash_recovery.shutil, 'copyfile', copy_slowly)
    assert holds(crashed) == 30


def test_a_journal_that_names_other_files_deletes_none(crashed, tmp_path):
    """SQLite deletes the file that a journal names as that of several databases."""
    victim, journal = tmp_path / 'victim', crashed.with_name('map.db-journal')
    victim.write_text('of somebody')
    name = os.fsencode(victim)
    end = len(name).to_bytes(4, 'big') + sum(name).to_bytes(4, 'big')
    magic, page = bytes.fromhex('d9d505f920a163d7'), (2**30 // PAGE_BYTES + 1).to_bytes(4, 'big')
    journal.write_bytes(journal.read_bytes() + page + name + end + magic)
    for use in (open_map, lambda path: MapWriter(path, ENCODING, APART, append=True)):
        with pytest.raises(MapError, match='names other files'):
            use(crashed)
    save_map(drawn(3), crashed)
    assert victim.read_text() == 'of somebody' and len(open_map(crashed)) == 3


@pytest.mark.parametrize('then', [lambda path: Appender(path, ENCODING, APART).close(), unlink])
def test_a_part_that_a_killed_save_left_is_deleted(path, tmp_path, then):
    """Killed once before and once after something is in the part; what is others' stays."""
    for moment in ('__init__', 'commit'):
        if not os.fork():
            setattr(MapWriter, moment, lambda *_, **__: os.kill(os.getpid(), signal.SIGKILL))
            save_map(drawn(3), path)
        assert os.waitstatus_to_exitcode(os.wait()[1]) == -signal.SIGKILL
        assert len(list(tmp_path.glob('map.db.*.part'))) == 1
    others = [tmp_path / name for name in ('map.db.mine.part', 'map.db.abcdefgh.part')]
    for one in others:
        one.mkdir()
        (one / 'map.db').touch()
    (tmp_path / 'map.db.12345678.part').mkdir(0o700)
    (tmp_path / 'map.db.12345678.part' / 'notes').touch()
    then(path)
    kept = {'map.db', 'map.db.12345678.part', *(one.name for one in others)}
    assert {one.name for one in tmp_path.iterdir()} == kept


# Damage in the log of a crashed map, once for each kind of byte; bench/torture flips any.
FRAME = 24 + 16_384  # bytes of the log for a page; 32 stand before the first


def flip(at):
    def change(data):
        data[at] ^= 16

    return change


def declare(page_bytes):
    def change(data):
        data[8:12] = page_bytes.to_bytes(4, 'big')
        sums = _checksum(bytes(data[:24]), '<>'[data[3] & 1], np.zeros(2, np.uint32))
        data[24:32] = sums.astype('>u4').tobytes()

    return change


def tear(data):
    data[-9000:] = bytes(9000)


@pytest.mark.parametrize(
    ('commits', 'change', 'left'),
    [
        (1, bytes, 4),  # nothing is damaged
        (3, bytes, 6),
        (3, tear, 5),
        *((1, flip(at), 2) for at in (-1, -FRAME, 32, 32 + FRAME)),
        *((3, flip(at), 5) for at in (-1, -FRAME)),
    ],
)
def test_a_damaged_last_commit_is_passed_over_like_half_a_commit(path, commits, change, left):
    crash(path, 2, *range(4, 4 + commits))
    data = bytearray(log_of(path).read_bytes())
    change(data)
    log_of(path).write_bytes(data)
    assert len(MapReader(path)) == left


@pytest.mark.parametrize(
    ('commits', 'change'),
    [
        *((1, flip(at)) for at in (0, 9, 17, 25)),
        *((3, flip(at)) for at in (0, 32, 36, 32 + 17, 32 + 21, 32 + 30, 32 + FRAME - 1)),
        *((3, declare(size)) for size in (0, 3, 1000, 1 << 31)),
    ],
)
def test_damage_that_commits_follow_is_reported(path, commits, change):
    crash(path, 2, *range(4, 4 + commits))
    data = bytearray(log_of(path).read_bytes())
    change(data)
    log_of(path).write_bytes(data)
    for use in (MapReader, lambda path: MapWriter(path, ENCODING, APART, append=True)):
        with pytest.raises(MapError, match=r'map\.db-wal: damaged at byte \d+; .* opens without'):
            use(path)
    assert log_of(path).read_bytes() == data


@pytest.mark.parametrize('size', [0, 31])
def test_a_log_that_is_emptied_while_it_is_opened_is_not_damaged(size):
    assert _damaged_at(BytesIO(bytes(size))) == -1


def test_a_log_of_a_terabyte_takes_neither_memory_nor_time(path):
    crash(path, 2, 4, 5, 6)
    with log_of(path).open('r+b') as log:
        log.truncate(10**12)
    started_s = time.thread_time()
    assert len(MapReader(path)) == 6
    assert time.thread_time() - started_s < 2
