# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
How a map is laid out in its SQLite file, format 3.

`places` is read when a map is opened; `pictures` holds what is read when it is needed. The cells
are float16, divided by 64, in planes of one byte a cell: the lower bytes of the 8 bins, then the
upper ones of the first 7. No number is negative, so the upper byte of the eighth bin fits into
their top bits, the lowest bit into that of the first: 17.0 kB a place, not 18.0. A row of either
table has its CRC-32.
"""

import json
from pathlib import Path
import sqlite3
import zlib

from convseq_ros.config import EncodingConfig, EVERY_FRAME, KeyframeConfig
from convseq_ros.core.compiled import kernels_of
from convseq_ros.core.encoding.descriptor import HOG
from convseq_ros.errors import ConfigError, MapError
import numpy as np
import numpy.typing as npt

FORMAT_VERSION = 3  # PRAGMA user_version
APPLICATION_ID = 0x43565351  # PRAGMA application_id; CVSQ
SCHEMA = f"""
PRAGMA application_id = {APPLICATION_ID};
PRAGMA user_version = {FORMAT_VERSION};
CREATE TABLE about (name TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE places (
    reference_index INTEGER PRIMARY KEY, stamp_ns INTEGER NOT NULL, source TEXT NOT NULL,
    x REAL, y REAL, z REAL, qx REAL, qy REAL, qz REAL, qw REAL,
    pooled BLOB NOT NULL, crc32 INTEGER NOT NULL
);
CREATE TABLE pictures (
    reference_index INTEGER PRIMARY KEY,
    cells BLOB NOT NULL, thumbnail BLOB NOT NULL, crc32 INTEGER NOT NULL
);
"""

_TOP = np.uint8(128)  # the top bit of a byte
_TOP_BITS = np.arange(HOG.bins - 1, 0, -1, dtype=np.uint8)[:, None]


def encode_cells(packed: npt.NDArray[np.float16]) -> bytes:
    """Return packed cells (S, S, 8) as they are stored; ValueError if one is negative."""
    halves = packed.reshape(-1, HOG.bins).view(np.uint16).T
    upper = (halves >> 8).astype(np.uint8)
    if (upper & _TOP).any():
        raise ValueError('cells are sums of strengths, which are not negative')
    upper[:-1] |= upper[-1] << _TOP_BITS & _TOP
    return halves.astype(np.uint8).tobytes() + upper[:-1].tobytes()


def decode_cells(stored: bytes, cell_shape: tuple[int, int, int]) -> npt.NDArray[np.float16]:
    """Return stored cells, packed; ValueError if they are not of that shape."""
    planes = np.frombuffer(stored, np.uint8).reshape(2 * HOG.bins - 1, -1)
    halves = np.empty((planes.shape[1], HOG.bins), np.uint16)
    kernels_of(__package__).join_bytes(planes, halves)
    return halves.view(np.float16).reshape(cell_shape)


def row_crc(plain: object, *blobs: bytes) -> int:
    """Return the checksum of a row of either table: numbers and texts, then blobs."""
    return zlib.crc32(b''.join((repr(plain).encode(), *blobs)))


def checked_settings(
    path: Path,
    database: sqlite3.Connection,
    encoding: EncodingConfig | None,
    keyframes: KeyframeConfig | None,
) -> tuple[EncodingConfig, KeyframeConfig]:
    """
    Return the settings asked for, by default the map's: every frame, in maps that do not say.

    MapError if the file is foreign, of another format or made with other settings.
    """
    if database.execute('PRAGMA application_id').fetchone()[0] != APPLICATION_ID:
        raise MapError(f'{path}: not a convseq map but another SQLite file')
    version = database.execute('PRAGMA user_version').fetchone()[0]
    if version != FORMAT_VERSION:
        raise MapError(
            f'{path}: map format {version}, this program reads {FORMAT_VERSION}; '
            f'{"update convseq_ros" if version > FORMAT_VERSION else "build the map again"}'
        )
    said = dict(database.execute('SELECT name, value FROM about'))
    try:
        settings = json.loads(said['encoding'])
        made_with, apart = EncodingConfig(**settings), EVERY_FRAME
        if 'keyframes' in said:
            apart = KeyframeConfig(**json.loads(said['keyframes']))
    except (KeyError, TypeError, ValueError, RecursionError, ConfigError) as error:
        raise MapError(f'{path}: damaged map (settings: {error}); build it again') from error
    size_px = (encoding or made_with).image_size_px
    asked = {'image_size_px': size_px, **(keyframes or apart).spacing}
    settings |= apart.spacing
    for name, wanted in asked.items():
        if (made := settings.get(name)) != wanted:
            raise MapError(
                f'{path}: made with {name} {made}, asked for {wanted}; '
                f'set {name} to {made} or build the map again'
            )
    return encoding or made_with, keyframes or apart
