# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
How a map is laid out in its SQLite file, format 2.

`places` is read when a map is opened; `pictures` holds what is read when it is needed. The cells
are float16, divided by 64: the lower bytes as they are, then the upper ones, bin after bin, as a
zlib stream, which loses nothing and saves a sixth. A row of either table has its CRC-32.
"""

import json
from pathlib import Path
import sqlite3
from typing import Any
import zlib

from convseq_ros.config import EncodingConfig
from convseq_ros.core.hog import BINS
from convseq_ros.errors import ConfigError, MapError
import numpy as np
import numpy.typing as npt

FORMAT_VERSION = 2
APPLICATION_ID = 0x43565351
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


def cell_settings(encoding: EncodingConfig) -> dict[str, int]:
    """Return the settings that the stored cells depend on."""
    return {'image_size_px': encoding.image_size_px}


def encode_cells(packed: npt.NDArray[np.float16]) -> bytes:
    """Return packed cells (S, S, 8) as they are stored."""
    parts = packed.astype('<f2', copy=False).reshape(-1, BINS, 1).view(np.uint8)
    # Huffman codes alone: searching for repetitions takes three times as long and finds none.
    code = zlib.compressobj(1, strategy=zlib.Z_HUFFMAN_ONLY)
    return parts[..., 0].tobytes() + code.compress(parts[..., 1].T.tobytes()) + code.flush()


def decode_cells(stored: bytes, cell_shape: tuple[int, int, int]) -> npt.NDArray[np.float16]:
    """Return stored cells, packed; ValueError or zlib.error if they are not of that shape."""
    rows, columns, bins = cell_shape
    count = rows * columns * bins
    parts = np.empty((rows * columns, bins, 2), np.uint8)
    parts[..., 0] = np.frombuffer(stored, np.uint8, count).reshape(-1, bins)
    upper = zlib.decompress(memoryview(stored)[count:])
    parts[..., 1] = np.frombuffer(upper, np.uint8).reshape(bins, -1).T
    return parts.view('<f2').reshape(cell_shape)


def place_crc(plain: tuple[Any, ...], pooled: bytes) -> int:
    """Return the checksum of a row of `places`: all numbers and the source, and a blob."""
    return zlib.crc32(pooled, zlib.crc32(repr(plain).encode()))


def picture_crc(index: int, cells: bytes, thumbnail: bytes) -> int:
    """Return the checksum of a row of `pictures`."""
    return zlib.crc32(thumbnail, zlib.crc32(cells, zlib.crc32(b'%d' % index)))


def checked_encoding(
    path: Path, database: sqlite3.Connection, encoding: EncodingConfig | None
) -> EncodingConfig:
    """
    Return how the images of a map were encoded.

    Parameters
    ----------
    path : Path
        Its name, for messages.
    database : sqlite3.Connection
        The map.
    encoding : EncodingConfig, optional
        How query images will be encoded; without it the map's own settings are taken.

    Raises
    ------
    MapError
        If the file is foreign, of another format or made with other settings.

    """
    if database.execute('PRAGMA application_id').fetchone()[0] != APPLICATION_ID:
        raise MapError(f'{path}: not a convseq map but another SQLite file')
    version = database.execute('PRAGMA user_version').fetchone()[0]
    if version != FORMAT_VERSION:
        raise MapError(
            f'{path}: map format {version}, this program reads {FORMAT_VERSION}; '
            f'{"update convseq_ros" if version > FORMAT_VERSION else "build the map again"}'
        )
    about = dict(database.execute('SELECT name, value FROM about'))
    try:
        settings = json.loads(about['encoding'])
        made_with = EncodingConfig(**settings)
    except (KeyError, TypeError, ValueError, ConfigError) as error:
        raise MapError(f'{path}: damaged map (settings: {error}); build it again') from error
    for name, wanted in cell_settings(encoding or made_with).items():
        if settings.get(name) != wanted:
            raise MapError(
                f'{path}: made with {name} {settings.get(name)}, asked for {wanted}; '
                f'set {name} to {settings.get(name)} or build the map again'
            )
    return encoding or made_with
