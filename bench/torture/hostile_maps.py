# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Hostile maps with valid checksums: what they declare, what they hold, what they would cause."""

from collections.abc import Callable, Iterator
from contextlib import redirect_stdout, suppress
from functools import partial
from io import StringIO
import json
import os
from pathlib import Path
import random
import sqlite3
import tempfile

from convseq_ros.cli import main as convseq
from convseq_ros.core.map.format import PAGE_BYTES, row_crc
from convseq_ros.core.map.writer import MapWriter, save_map
import cv2

from bench.torture import corpus
from bench.torture.attack import Attack, Try
from bench.torture.forked import problem_of
from bench.torture.maps import APART, drawn, ENCODING

_PLACES, _SIZE = 20, ('--image-size-px', '64')
_ENDLESS = 'WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x FROM c) SELECT'
_TABLES = 'about', 'sessions', 'places', 'pictures', 'images', 'links', 'depths', 'vectors'
_OF_A_PLACE = _TABLES[2:5]
_NUMBERS = 0, -1, 2**31, 10**8, 2**53, 2**62, 2**63 - 1, -(2**63), 1.5, -0.0, 1e308, float('inf')
_SIZES = 0, 1, 255, 256, 257, 10**6  # of a value, in bytes
_TEXTS = '', 'text', 'x' * 10**6, '[' * 100_000, '{"image_size_px": 1e999}', '{}', '[]', 'null'
# Values in JSON, in addition to the numbers.
_IN_JSON = (
    True, None, 'x', '', [], {}, 10**400, float('nan'), 1e-300, 45, 90, [float('inf')] * 5,
    [0.0] * 100_000, 'equidistant', '#0000', '#ffff', '#0', '#' + 'f' * 10**6, '/dev/zero',
    {'position': [0, 0, 1e308], 'orientation': 4 * [0]},
)  # fmt: skip
_CAMERA = {
    'width_px': 64, 'height_px': 48, 'fx_px': 50.0, 'fy_px': 50.0, 'cx_px': 32.0, 'cy_px': 24.0,
    'distortion_model': 'plumb_bob', 'distortion': [0.0] * 5, 'mount': None,
}  # fmt: skip
_ENCODING = {
    'image_size_px': 64, 'resize': 'exact', 'image_mask': '', 'image_rotation_deg': 0,
}  # fmt: skip

Change = Callable[[sqlite3.Connection, random.Random], None]


def _run(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Repeatedly make a hostile map, and run a command with it in a fork."""
    draw, drive, ways = random.Random(seed), folder / 'drive', [*_WAYS.items()]
    cv2.setNumThreads(1)
    drive.mkdir()
    for index in range(3):
        cv2.imwrite(str(drive / f'{index}.png'), corpus.gray(index))
    with redirect_stdout(StringIO()):  # compile and import once, before the forks
        convseq(['build-map', str(drive), str(folder / 'warm.db'), *_SIZE])
    for number in range(count):
        with tempfile.TemporaryDirectory(dir=folder) as scratch:
            path, victim = Path(scratch, 'map.db'), Path(scratch, 'victim')
            victim.write_text('of somebody')
            save_map(drawn(_PLACES), path)
            name, way = ways[number % len(ways)]
            way(path, draw)
            command, arguments = draw.choice([*_commands(path, drive).items()])
            problem = problem_of(lambda arguments=arguments: convseq(arguments))
            if not problem and victim.read_text() != 'of somebody':
                problem = 'another file was changed'
            yield Try(f'{number}: {name}, {command}', problem)


def _commands(path: Path, drive: Path) -> dict[str, list[str]]:
    """Return the commands that use a map, by name."""
    replay = ['replay', str(drive), '--map', str(path), *_SIZE]
    replay += ['--output', str(path.with_name('rows.csv')), '--mode']
    return {
        'info': ['info', str(path)],
        'replay': [*replay, 'preloaded'],
        'online': [*replay, 'online'],
        'append': ['build-map', str(drive), str(path), '--append', *_SIZE],
    }


def _execute(change: Change, path: Path, draw: random.Random) -> None:
    """Apply a change to a map."""
    database = sqlite3.connect(path, isolation_level=None)
    database.execute('BEGIN')
    change(database, draw)
    database.execute('COMMIT')
    database.close()


def _value(database: sqlite3.Connection, draw: random.Random) -> None:
    """Give a row of any table an odd value of any kind in any column, with a valid checksum."""
    rows = {name: database.execute(f'SELECT * FROM {name}').fetchall() for name in _TABLES}
    table = draw.choice([name for name in _TABLES if rows[name]])
    key, *others, _ = [row[1] for row in database.execute(f'PRAGMA table_info({table})')]
    size = draw.choice(_SIZES)
    numbers, texts = (draw.choice(_NUMBERS), draw.randrange(_PLACES)), (draw.choice(_TEXTS), None)
    odd = draw.choice((*numbers, *texts, draw.randbytes(size), bytes(size)))
    with suppress(sqlite3.Error):  # such as a second row with that key
        change = f'UPDATE {table} SET {draw.choice([key, *others])} = ? WHERE {key} = ?'
        database.execute(change, (odd, draw.choice(rows[table])[0]))
        _make_sound(database, table)


def _setting(database: sqlite3.Connection, draw: random.Random) -> None:
    """Give the camera of a session, or the encoding, an odd value in its JSON."""
    table, known, column = draw.choice(
        (('sessions', _CAMERA, 'camera'), ('about', _ENCODING, 'value'))
    )
    odd = {draw.choice([*known]): draw.choice((*_NUMBERS, *_IN_JSON))}
    only = '' if table == 'sessions' else "WHERE name = 'encoding'"
    database.execute(f'UPDATE {table} SET {column} = ? {only}', (json.dumps(known | odd),))
    _make_sound(database, table)


def _make_sound(database: sqlite3.Connection, table: str) -> None:
    key = database.execute(f'PRAGMA table_info({table})').fetchone()[1]
    for row in database.execute(f'SELECT * FROM {table}').fetchall():
        sound = row_crc(row[:-1]), row[0]
        database.execute(f'UPDATE {table} SET crc32 = ? WHERE {key} = ?', sound)


def _trigger(database: sqlite3.Connection, draw: random.Random) -> None:
    on, then = draw.choice(_TABLES), draw.choice(_TABLES)
    what = draw.choice((f'DELETE FROM {then}', f'{_ENDLESS} x FROM c'))
    database.execute(f'CREATE TRIGGER own AFTER INSERT ON {on} BEGIN {what}; END')


def _view(database: sqlite3.Connection, draw: random.Random) -> None:
    table = draw.choice(_TABLES)
    columns = [row[1] for row in database.execute(f'PRAGMA table_info({table})')]
    database.execute(f'ALTER TABLE {table} RENAME TO hidden')
    fakes = ', '.join(f'1 AS {name}' for name in columns)
    database.execute(f'CREATE VIEW {table} AS {_ENDLESS} {fakes} FROM c')


def _table_of_another(database: sqlite3.Connection, draw: random.Random) -> None:
    """Let a table read the pages of another, while the text of the schema is valid."""
    table, other = draw.choice(_TABLES), draw.choice(_TABLES)
    database.execute('PRAGMA writable_schema = ON')
    database.execute(
        'UPDATE sqlite_master SET rootpage = (SELECT rootpage FROM sqlite_master WHERE name = ?) '
        'WHERE name = ?',
        (other, table),
    )


def _index(database: sqlite3.Connection, draw: random.Random) -> None:
    last = draw.choice([one for one in _NUMBERS if one and isinstance(one, int)])
    for table in draw.choice((_OF_A_PLACE, _OF_A_PLACE[:1])):
        which = f'WHERE reference_index = {_PLACES - 1}'
        database.execute(f'UPDATE {table} SET reference_index = {last} {which}')
        _make_sound(database, table)


def _huge(database: sqlite3.Connection, draw: random.Random) -> None:
    """Store a huge value, most of which is a hole in the file."""
    table, column = draw.choice((('pictures', 'thumbnail'), ('places', 'pooled')))
    database.execute(f'UPDATE {table} SET {column} = zeroblob(300000000) WHERE rowid = 3')


def _many_links(database: sqlite3.Connection, draw: random.Random) -> None:
    count = draw.choice((1_000, 100_000))
    database.execute(
        f'WITH RECURSIVE c(x) AS (SELECT {_PLACES} UNION ALL SELECT x + 1 FROM c LIMIT {count}) '
        'INSERT INTO links SELECT x, x - 1, 0, NULL, NULL, NULL, 0 FROM c'
    )


def _holes(path: Path, draw: random.Random) -> None:
    """Enlarge the file to terabytes, most of which are a hole."""
    size = draw.choice((10**10, 10**12))
    data = bytearray(path.read_bytes())
    data[28:32] = (size // PAGE_BYTES).to_bytes(4, 'big')
    path.write_bytes(data)
    with path.open('r+b') as file:
        file.truncate(size // PAGE_BYTES * PAGE_BYTES)


def _pages(path: Path, draw: random.Random) -> None:
    """Copy pages over others, so that a tree leads to itself."""
    data = bytearray(path.read_bytes())
    for _ in range(draw.choice((1, 2, 8))):
        one, other = (draw.randrange(1, len(data) // PAGE_BYTES) * PAGE_BYTES for _ in range(2))
        data[one : one + PAGE_BYTES] = data[other : other + PAGE_BYTES]
    path.write_bytes(data)


def _journal(path: Path, draw: random.Random) -> None:
    """Add a hot journal that names another file, which SQLite would delete."""
    name = bytes(path.with_name('victim'))
    page = draw.randbytes(PAGE_BYTES)
    head = bytes.fromhex('d9d505f920a163d7') + b''.join(
        number.to_bytes(4, 'big')
        for number in (1, 7, path.stat().st_size // PAGE_BYTES, 512, PAGE_BYTES)
    )
    crc = (7 + sum(page[at] for at in range(PAGE_BYTES - 200, 0, -200))) & 0xFFFFFFFF
    body = (2).to_bytes(4, 'big') + page + crc.to_bytes(4, 'big')
    end = draw.choice((b'', (2**30 // PAGE_BYTES + 1).to_bytes(4, 'big') + name))
    if end:
        end += len(name).to_bytes(4, 'big') + sum(name).to_bytes(4, 'big') + head[:8]
    path.with_name('map.db-journal').write_bytes(head.ljust(512, b'\0') + body + end)


def _wal(path: Path, draw: random.Random) -> None:
    """Mark the file as having a log, and write a log beside it."""
    _mark_ahead(path)
    path.with_name('map.db-wal').write_bytes(draw.choice((b'', draw.randbytes(5000))))


def _log_of_another(path: Path, draw: random.Random) -> None:
    """Write a valid log of another map beside the file, which may or may not have a log."""
    other = path.with_name('other.db')
    with MapWriter(other, ENCODING, APART) as writer:
        writer.write_ahead()
        writer.copy(drawn(draw.randint(1, 2 * _PLACES), 1), 1)
        log = other.with_name('other.db-wal').read_bytes()
    path.with_name('map.db-wal').write_bytes(log)
    if draw.random() < 0.5:
        _mark_ahead(path)


def _pipe(path: Path, draw: random.Random) -> None:
    """Create a pipe beside the file, on which a reader would block."""
    os.mkfifo(path.with_name(f'map.db-{draw.choice(("wal", "journal", "shm"))}'))
    if draw.random() < 0.5:
        _mark_ahead(path)


def _mark_ahead(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[18:20] = b'\2\2'
    path.write_bytes(data)


_CHANGES: dict[str, Change] = {
    **{f'value {number}': _value for number in range(8)},
    **{f'setting {number}': _setting for number in range(3)},
    'trigger': _trigger,
    'view': _view,
    'table of another': _table_of_another,
    'last index': _index,
    'huge value': _huge,
    'links without places': _many_links,
}
_WAYS: dict[str, Callable[[Path, random.Random], None]] = {
    **{name: partial(_execute, change) for name, change in _CHANGES.items()},
    'holes': _holes,
    'pages': _pages,
    'journal': _journal,
    'log': _wal,
    'log of another': _log_of_another,
    'pipe': _pipe,
}
ATTACKS = {
    'hostile_maps': Attack(
        'A map with triggers, endless views, further tables, indices out of reach, odd values in '
        'any column, odd settings of cameras and images, values of gigabytes, links without '
        'places, JSON nested 100,000 deep, a file that is mostly holes, pages that lead to each '
        'other, a journal that names another file, a log of another map, or pipes; `info`, '
        '`replay` preloaded and online, and `build-map --append`',
        'exit 0 or 1, no traceback, within 5 s, below 1 GB, and no other file is touched',
        1_000, 100, 25, _run,
    )
}  # fmt: skip
