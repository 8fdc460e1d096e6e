# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bring a map of format 3 up to date: `convseq convert OLD NEW`."""

import argparse
from contextlib import closing
import json
import math
from pathlib import Path
import zlib

from convseq_ros.config import EncodingConfig, EVERY_FRAME, KeyframeConfig
from convseq_ros.core.encoding.descriptor import cell_shape
from convseq_ros.core.map.database import Database, explained
from convseq_ros.core.map.format import decode_cells, FORMAT_VERSION
from convseq_ros.core.map.opening import open_to_read
from convseq_ros.core.map.place import Picture, Place
from convseq_ros.core.map.replacing import replaced
from convseq_ros.core.map.writer import MapWriter
from convseq_ros.core.types import Pose
from convseq_ros.errors import ConfigError, MapError
import numpy as np
import numpy.typing as npt

_FORMAT = 3
_SCHEMA = {
    'about': 'CREATE TABLE about (name TEXT PRIMARY KEY, value TEXT NOT NULL)',
    'sqlite_autoindex_about_1': None,
    'places': """CREATE TABLE places (
    reference_index INTEGER PRIMARY KEY, stamp_ns INTEGER NOT NULL, source TEXT NOT NULL,
    x REAL, y REAL, z REAL, qx REAL, qy REAL, qz REAL, qw REAL,
    pooled BLOB NOT NULL, crc32 INTEGER NOT NULL
)""",
    'pictures': """CREATE TABLE pictures (
    reference_index INTEGER PRIMARY KEY,
    cells BLOB NOT NULL, thumbnail BLOB NOT NULL, crc32 INTEGER NOT NULL
)""",
}
_BINS = 8  # numbers in a cell
_TOP = np.uint8(128)  # the top bit of a byte
_PLANES = 2 * _BINS - 1  # of bytes: lower ones of 8 numbers, upper ones of 7


def describe(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument('old', type=Path, help='map of format 3; it is not changed')
    parser.add_argument('new', type=Path, help='map file to make')


def run(chosen: argparse.Namespace) -> int:
    """Convert, and say what was made."""
    places = convert(chosen.old, chosen.new)
    print(f'{chosen.new}: {places} references, format {FORMAT_VERSION}')
    return 0


def convert(old: Path, new: Path) -> int:
    """
    Write a map of format 3 as one of today's; return how many places it has.

    The old one is not changed, and checked as far as it has checksums. MapError if it is damaged
    or of another format, or if the new one exists already or cannot be written.
    """
    with explained(old), closing(open_to_read(old)) as database:
        if database.number('PRAGMA user_version') == FORMAT_VERSION:
            raise MapError(f'{old}: is of format {FORMAT_VERSION} already')
        database.check(old, _FORMAT, _SCHEMA)
        with database.transaction(), replaced(new) as part:
            if new.exists() and new.stat().st_size:
                raise MapError(f'{new}: exists already; name another file')
            settings = _settings(database)
            shape = cell_shape(settings[0].image_size_px)
            ends = [_end(database, table) for table in ('places', 'pictures')]
            with MapWriter(part, *settings) as writer:
                for index in range(max(ends)):
                    writer.add(*_place(database, index, shape))
            return writer.committed


def _settings(database: Database) -> tuple[EncodingConfig, KeyframeConfig]:
    said: dict[str, str] = dict(database.rows('SELECT name, value FROM about'))
    try:
        keyframes = EVERY_FRAME
        if 'keyframes' in said:
            keyframes = KeyframeConfig(**json.loads(said['keyframes']))
        # Maps of format 3 do not say how images were resized.
        return EncodingConfig(**json.loads(said['encoding']), resize='linear'), keyframes
    except (KeyError, TypeError, RecursionError, ConfigError) as error:
        raise ValueError(f'settings: {error}') from error


def _end(database: Database, table: str) -> int:
    return database.number(f'SELECT coalesce(max(reference_index), -1) + 1 FROM {table}')


def _place(
    database: Database, index: int, shape: tuple[int, int, int]
) -> tuple[Place, Picture, npt.NDArray[np.float16]]:
    """Return what is stored of a place; ValueError if it is missing or fails a checksum."""
    found = [
        row
        for table in ('places', 'pictures')
        for row in database.rows(f'SELECT * FROM {table} WHERE reference_index = ?', (index,))
    ]
    if len(found) != 2:
        raise ValueError(f'reference {index} is missing')
    (*plain, pooled, crc), (_, cells, thumbnail, other_crc) = found
    if (crc, other_crc) != (_crc(tuple(plain), pooled), _crc(index, cells, thumbnail)):
        raise ValueError(f'reference {index} fails its checksum')
    _, stamp_ns, source, *numbers = plain
    x, y, z, qx, qy, qz, qw = (math.nan if each is None else each for each in numbers)
    place = Place(stamp_ns, source, Pose((x, y, z), (qx, qy, qz, qw)))
    descriptor = np.frombuffer(pooled, '<f2')
    if not np.isfinite(descriptor).all():
        raise ValueError(f'reference {index} has numbers without a value')
    picture = Picture(decode_cells(_unpacked(cells), shape), thumbnail)
    return place, picture, descriptor.astype(np.float16)


def _crc(plain: object, *blobs: bytes) -> int:
    return zlib.crc32(b''.join((repr(plain).encode(), *blobs)))


def _unpacked(stored: bytes) -> bytes:
    """
    Return cells as they are stored today.

    Before, they lay in planes of one byte a cell: the lower bytes of the 8 numbers, then the upper
    ones of the first 7, which have the bits of the eighth's upper byte on top.
    """
    planes = np.frombuffer(stored, np.uint8).reshape(_PLANES, -1)
    lower, upper = planes[:_BINS].T, planes[_BINS:]
    last = np.packbits(upper >= _TOP, axis=0, bitorder='little')
    halves = np.concatenate([upper & ~_TOP, last]).T.astype('<u2') << 8 | lower
    return halves.astype('<u2').tobytes()
