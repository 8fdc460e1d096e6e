# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Hostile maps with valid checksums: their declarations, and the actions that they would cause."""

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
import numpy as np

from bench.torture.attack import Try
from bench.torture.forked import problem_of
from bench.torture.maps import APART, drawn, ENCODING

ABOUT = (
    'A map with triggers, endless views, further tables, indices out of reach, links to places '
    'that are not there, to later ones or in a circle, values of '
    'gigabytes, numbers that are none, JSON nested 100,000 deep, a file that is mostly holes, '
    'pages that lead to each other, a journal that names another file, a log of another map, or '
    'pipes; `info`, `replay` preloaded and online, and `build-map --append`'
)
ORACLE = 'exit 0 or 1, no traceback, within 5 s, below 1 GB, and no other file is touched'
COUNT, PORTION, SHORT, SEED = 1_000, 100, 25, 16
_PLACES, _SIZE = 20, ('--image-size-px', '64')
_ENDLESS = 'WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x FROM c) SELECT'
_TABLES = 'about', 'sessions', 'places', 'pictures', 'images', 'links', 'depths', 'vectors'
_OF_A_PLACE = _TABLES[2:5]
_NUMBERS = 0, -1, 2**31, 10**8, 2**53, 2**62, 2**63 - 1, -(2**63)
_MASKS = '#0000', '#ffff', '#0', '#' + 'f' * 10**6, '/dev/zero', '', 7
_OF_SETTINGS = ('[' * 100_000, '{"image_size_px": 1e999}', '{}', '[]', '0', 'null', '')

Change = Callable[[sqlite3.Connection, random.Random], None]


def run(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Repeatedly make a hostile map, and run a command with it in a fork."""
    draw, ways = random.Random(seed), list(_WAYS.items())
    cv2.setNumThreads(1)
    drive = folder / 'drive'
    drive.mkdir()
    for index in range(3):
        noise = np.random.default_rng(index).integers(0, 256, (48, 64), np.uint8)
        cv2.imwrite(str(drive / f'{index}.png'), noise)
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


def _set(table: str, column: str, value: Callable[[random.Random], object]) -> Change:
    """Return a change of one value of a row, with a valid checksum."""

    def change(database: sqlite3.Connection, draw: random.Random) -> None:
        columns = [row[1] for row in database.execute(f'PRAGMA table_info({table})')]
        key = columns[0]
        (chosen,) = draw.choice(database.execute(f'SELECT {key} FROM {table}').fetchall())
        database.execute(f'UPDATE {table} SET {column} = ? WHERE {key} = ?', (value(draw), chosen))
        _make_sound(database, table, key)

    return change


def _make_sound(database: sqlite3.Connection, table: str, key: str = 'reference_index') -> None:
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


def _hidden_view(database: sqlite3.Connection, draw: random.Random) -> None:
    """Make a table a view, or computed, while the text of the schema is that of a valid map."""
    table = draw.choice(_TABLES)
    database.execute('PRAGMA writable_schema = ON')
    other = draw.choice(_TABLES)
    database.execute(
        'UPDATE sqlite_master SET rootpage = (SELECT rootpage FROM sqlite_master WHERE name = ?) '
        'WHERE name = ?',
        (other, table),
    )


def _index(database: sqlite3.Connection, draw: random.Random) -> None:
    last = draw.choice(_NUMBERS[1:])
    for table in draw.choice((_OF_A_PLACE, _OF_A_PLACE[:1])):
        which = f'WHERE reference_index = {_PLACES - 1}'
        database.execute(f'UPDATE {table} SET reference_index = {last} {which}')
        _make_sound(database, table)


def _blob(draw: random.Random) -> object:
    size = draw.choice((0, 1, 255, 256, 257, 10**6))
    return draw.choice((draw.randbytes(size), bytes(size), 'text', 1.5, -(2**63)))


def _huge(database: sqlite3.Connection, draw: random.Random) -> None:
    """Store a huge value, most of which is a hole in the file."""
    table, column = draw.choice((('pictures', 'thumbnail'), ('places', 'pooled')))
    database.execute(f'UPDATE {table} SET {column} = zeroblob(300000000) WHERE rowid = 3')


def _link(database: sqlite3.Connection, draw: random.Random) -> None:
    """Add a link from or to missing places, to itself, to a later place, or in a circle."""
    column = draw.choice(('place', 'other', 'anchor', 'confidence', 'inliers', 'relative'))
    numbers = (*_NUMBERS, *range(_PLACES), None, 'text', 1.5)
    value = _blob if column == 'relative' else lambda draw: draw.choice(numbers)
    with suppress(sqlite3.Error):  # a second link of a place, or a text as its number
        _set('links', column, value)(database, draw)


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


def _camera(draw: random.Random) -> str:
    numbers = (0, -1, 1, 320.5, 1e-300, 1e308, 10**400, float('nan'), float('inf'), True, 'x', [])
    names = 'width_px', 'height_px', 'fx_px', 'fy_px', 'cx_px', 'cy_px'
    camera: dict[str, object] = {name: draw.choice((64, 48, 50.0)) for name in names}
    camera[draw.choice(names)] = draw.choice(numbers)
    if draw.random() < 0.7:
        camera['distortion_model'] = draw.choice(('plumb_bob', 'equidistant', 'x', '', 7))
        count = draw.choice((0, 1, 4, 5, 8, 12, 100_000))
        camera['distortion'] = [draw.choice(numbers[:9]) for _ in range(count)]
    if draw.random() < 0.3:
        camera['mount'] = draw.choice(
            ([], {}, 7, {'position': [0, 0, 1e308], 'orientation': 4 * [0]})
        )
    return json.dumps(camera)


def _encoding(database: sqlite3.Connection, draw: random.Random) -> None:
    text = json.dumps(
        {
            'image_size_px': draw.choice((0, 16, 64, 64, 2**31)),
            'resize': 'exact',
            'image_mask': draw.choice(_MASKS),
            'image_rotation_deg': draw.choice((0, 0, 90, 45, 1e999)),
        }
    )
    sound = text, row_crc(('encoding', text))
    database.execute("UPDATE about SET value = ?, crc32 = ? WHERE name = 'encoding'", sound)


_CHANGES: dict[str, Change] = {
    'trigger': _trigger,
    'view': _view,
    'table of another': _hidden_view,
    'last index': _index,
    'huge value': _huge,
    'setting': _set('about', 'value', lambda draw: draw.choice(_OF_SETTINGS)),
    'encoding': _encoding,
    'camera': _set('sessions', 'camera', lambda draw: draw.choice(_OF_SETTINGS)),
    'id': _set('sessions', 'id', lambda draw: draw.choice(('x' * 10**6, b'x', ''))),
    'numbers of a camera': _set('sessions', 'camera', _camera),
    'session': _set('places', 'session', lambda draw: draw.choice(_NUMBERS)),
    'stamp': _set('places', 'stamp_ns', lambda draw: draw.choice(_NUMBERS)),
    'position': _set(
        'places', 'x', lambda draw: draw.choice((None, float('inf'), 1e308, 'text', -0.0))
    ),
    'descriptor': _set('places', 'pooled', _blob),
    'cells': _set('pictures', 'cells', _blob),
    'thumbnail': _set('pictures', 'thumbnail', _blob),
    'image': _set('images', 'jpeg', _blob),
    'link': _link,
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
