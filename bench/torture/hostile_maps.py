# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Hostile maps with valid checksums: what they declare, what they hold, what they would cause."""

from collections.abc import Callable, Iterator
from contextlib import redirect_stdout, suppress
from dataclasses import asdict
from functools import partial
from io import StringIO
import json
import os
from pathlib import Path
import random
import sqlite3
import tempfile
from typing import Any

from convseq_ros.cli import main as convseq
from convseq_ros.core.map.format import PAGE_BYTES, row_crc, stored_settings
from convseq_ros.core.map.writer import save_map
from convseq_ros.core.types import Camera
import cv2

from bench import recordings
from bench.torture.attack import Try
from bench.torture.forked import ended
from bench.torture.maps import crash, drawn, ENCODING, log_of

_PLACES, _SIZE = 20, ('--image-size-px', '64')
_TABLES = 'about', 'sessions', 'places', 'pictures', 'images', 'links', 'vectors'
_NUMBERS = 0, -1, 2**31, 10**8, 2**53, 2**62, 2**63 - 1, -(2**63), 1.5, -0.0, 1e308, float('inf')
_SIZES = 0, 1, 255, 256, 257, 10**6  # of a value, in bytes
_TEXTS = '', 'text', 'x' * 10**6, '[' * 100_000, '{"image_size_px": 1e999}', '{}', '[]', 'null'
# Values in JSON, in addition to the numbers.
_IN_JSON: tuple[Any, ...] = (
    True, None, 'x', '', [], {}, 10**400, float('nan'), 1e-300, 45, 90, [float('inf')] * 5,
    [0.0] * 100_000, 'equidistant', '#0000', '#ffff', '#0', '#' + 'f' * 10**6, '/dev/zero',
    {'position': [0, 0, 1e308], 'orientation': 4 * [0]},
)  # fmt: skip
_CAMERA = asdict(Camera(64, 48, 50.0, 50.0, 32.0, 24.0, 'plumb_bob', (0.0,) * 5))

Change = Callable[[sqlite3.Connection, random.Random], None]


def hostile_maps(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Repeatedly make a hostile map, and run a command with it in a fork."""
    draw, drive = random.Random(seed), folder / 'drive'
    cv2.setNumThreads(1)
    recordings.write_pictures(drive, 3)
    with redirect_stdout(StringIO()):  # compile and import once, before the forks
        convseq(['build-map', str(drive), str(folder / 'warm.db'), *_SIZE])
    for number in range(count):
        with tempfile.TemporaryDirectory(dir=folder) as scratch:
            path = Path(scratch, 'map.db')
            save_map(drawn(_PLACES), path)
            attack = _ATTACKS[number % len(_ATTACKS)]
            attack(path, draw)
            command, arguments = draw.choice([*_commands(path, drive).items()])
            problem = ended(partial(convseq, arguments)).problem
            yield Try(f'{number}: {command}', problem)


def _commands(path: Path, drive: Path) -> dict[str, list[str]]:
    """Return the commands that use a map, by name."""
    replay = ['replay', str(drive), '--map', str(path), *_SIZE]
    replay += ['--output', str(path.with_name('rows.csv')), '--mode']
    return {
        'info': ['info', str(path)],
        'replay': [*replay, 'preloaded'],
        'online': [*replay, 'online'],
        'split': ['map', 'split', str(path), '-o', str(path.parent)],
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
        (('sessions', _CAMERA, 'camera'), ('about', stored_settings(ENCODING), 'value'))
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


def _table_of_another(database: sqlite3.Connection, draw: random.Random) -> None:
    """Let a table read the pages of another, while the text of the schema is valid."""
    table, other = draw.choice(_TABLES), draw.choice(_TABLES)
    database.execute('PRAGMA writable_schema = ON')
    database.execute(
        'UPDATE sqlite_master SET rootpage = (SELECT rootpage FROM sqlite_master WHERE name = ?) '
        'WHERE name = ?',
        (other, table),
    )


def _holes(path: Path, draw: random.Random) -> None:
    """Enlarge the file to terabytes, most of which are a hole."""
    size = draw.choice((10**10, 10**12))
    data = bytearray(path.read_bytes())
    data[28:32] = (size // PAGE_BYTES).to_bytes(4, 'big')
    path.write_bytes(data)
    with path.open('r+b') as file:
        file.truncate(size // PAGE_BYTES * PAGE_BYTES)


def _beside(path: Path, draw: random.Random) -> None:
    """Put a log of noise, that of another map or a pipe beside the file, which may expect it."""
    kind = draw.choice(('noise', 'another', 'pipe'))
    if kind == 'noise':
        log_of(path).write_bytes(draw.randbytes(draw.choice((0, 5000))))
    elif kind == 'another':
        other = path.with_name('other.db')
        crash(other, 1, draw.randint(2, 2 * _PLACES), drive=1)
        log_of(other).rename(log_of(path))
    else:
        os.mkfifo(path.with_name(f'map.db-{draw.choice(("wal", "journal", "shm"))}'))
    if draw.random() < 0.5:
        data = bytearray(path.read_bytes())
        data[18:20] = b'\2\2'
        path.write_bytes(data)


_CHANGES = *8 * [_value], *3 * [_setting], _table_of_another
_ATTACKS: tuple[Callable[[Path, random.Random], None], ...] = (
    *(partial(_execute, change) for change in _CHANGES), _holes, *3 * [_beside],
)  # fmt: skip
