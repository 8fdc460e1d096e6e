# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The links of a map in its file."""

from collections.abc import Sequence
import math
from pathlib import Path
import sqlite3

from convseq_ros.core.graph.links import Links, Row
from convseq_ros.core.map.database import Database, Rows
from convseq_ros.core.map.format import row_crc
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.rigid import vector
from convseq_ros.core.types import RelativePose
import numpy as np

_AT_ONCE = 8192  # rows, for some MB of memory
_UPPER = np.triu_indices(6)  # of a covariance
_NUMBERS = 33  # of a relative pose: orientation, position, direction, covariance, and two more
_OFF_UNIT = 1e-6  # that the length of an orientation may be


def read_links(database: Database, path: Path, reference_map: ReferenceMap) -> None:
    """Add its links to a map; its `problem` says how many are damaged, and left out."""
    start, count = 0, len(reference_map)
    off = f'SELECT count(*) FROM links WHERE place < 0 OR place >= {count}'
    asked = f'SELECT * FROM links WHERE place >= ? AND place < {count} ORDER BY place LIMIT ?'
    try:
        left_out = database.number(off)
        while rows := database.rows(asked, (start, _AT_ONCE)):
            places = [row[0] for row in rows]
            if places[0] < start or places != sorted({*places}):
                raise sqlite3.DatabaseError('a damaged page leads to others, perhaps in a circle')
            left_out += _add(reference_map.links, rows)
            start = places[-1] + 1
    except sqlite3.DatabaseError:
        database.roll_back()  # what was read before is sound
        problem = f'the links of places from {start} on are damaged'
    else:
        problem = f'{left_out} links are damaged' if left_out else ''
    if problem:
        reference_map.problem = f'{path}: {problem} and left out; all else works'


def _add(links: Links, rows: Rows) -> int:
    """Add links of stored rows, in order; return how many are damaged."""
    damaged = 0
    for place, other, anchor, confidence, inliers, relative, crc32 in rows:
        try:
            if crc32 != row_crc((place, other, anchor, confidence, inliers, relative)):
                raise ValueError('a link that fails its checksum')
            if other is None:
                links.add_first(place)
                continue
            whole = all(type(one) is int for one in (other, anchor, inliers or 0))
            if not whole or not 0 <= anchor <= other or not 0 <= (confidence or 0) <= 1:
                raise ValueError('a link that cannot be')
            measured = None if relative is None else _unpacked(relative)
            links.add(place, other, confidence, inliers, measured, anchor)
        except (TypeError, ValueError):
            damaged += 1
    return damaged


def write_links(database: Database, rows: Sequence[Row]) -> None:
    """Write links, in a transaction that is begun."""
    for place, one in rows:
        row: tuple[object, ...] = (place, *(None,) * 5)
        if one is not None:
            relative = one.relative and _packed(one.relative)
            row = place, one.other, one.anchor, one.confidence, one.inliers, relative
        database.rows(
            'INSERT OR REPLACE INTO links VALUES (?, ?, ?, ?, ?, ?, ?)', (*row, row_crc(row))
        )


def _packed(pose: RelativePose) -> bytes:
    """Return what is stored of a relative pose: 33 numbers, NaN for what is not known."""
    unknown = (math.nan,) * 3
    numbers = *pose.orientation, *(pose.position_m or unknown), *(pose.direction or unknown)
    return np.array(
        [*numbers, *pose.covariance[_UPPER], pose.inliers, pose.explains], '<f8'
    ).tobytes()


def _unpacked(stored: bytes) -> RelativePose:
    """Return a relative pose that was stored; ValueError or TypeError if it is none."""
    numbers = np.frombuffer(stored, '<f8')
    if len(numbers) != _NUMBERS or not np.isfinite([*numbers[:4], *numbers[10:]]).all():
        raise ValueError('a relative pose that is none')
    x, y, z, w = numbers[:4].tolist()
    if abs(math.hypot(x, y, z, w) - 1) > _OFF_UNIT:
        raise ValueError('a relative pose that is not turned')
    covariance = np.zeros((6, 6))
    covariance[_UPPER] = numbers[10:31]
    covariance.T[_UPPER] = numbers[10:31]
    position, direction = (
        vector(some) if np.isfinite(some).all() else None for some in numbers[4:10].reshape(2, 3)
    )
    inliers, explains = int(numbers[31]), bool(numbers[32])
    return RelativePose((x, y, z, w), position, direction, covariance, inliers, explains)


def takes_links(database: Database) -> bool:
    """Return whether a file takes further links: not if their table cannot be read."""
    try:
        return database.number('SELECT count(*) FROM links') >= 0
    except sqlite3.DatabaseError:
        database.roll_back()
        return False
