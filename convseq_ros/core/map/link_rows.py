# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The links of a map in its file, and in maps that are made of its places."""

from collections.abc import Sequence
from pathlib import Path
import sqlite3

from convseq_ros.core.graph.links import Links, Row
from convseq_ros.core.map.database import Database, Rows
from convseq_ros.core.map.format import FURTHER, row_crc
from convseq_ros.core.map.reference_map import ReferenceMap

_AT_ONCE = 8192  # rows, for some MB of memory


def read_links(database: Database, path: Path, reference_map: ReferenceMap) -> None:
    """Add its links to a map; those that are damaged are left out, and told as its `problem`."""
    if not database.has('links'):
        return
    start, count = 0, len(reference_map)
    off = f'SELECT count(*) FROM links WHERE place < 0 OR place >= {count}'
    asked = f'SELECT * FROM links WHERE place >= ? AND place < {count} ORDER BY place LIMIT ?'
    try:
        left_out = database.number(off)
        while rows := database.rows(asked, (start, _AT_ONCE)):
            left_out += _add(reference_map.links, rows)
            start = rows[-1][0] + 1
    except sqlite3.DatabaseError:
        database.roll_back()  # what was read before is sound
        said = f'the links of places from {start} on are damaged'
    else:
        said = f'{left_out} links are damaged' if left_out else ''
    if said:
        reference_map.problem = f'{path}: {said} and left out; all else works'


def _add(links: Links, rows: Rows) -> int:
    """Add links of stored rows, in order; return how many are damaged."""
    damaged = 0
    for place, anchor, crc32 in rows:
        is_sound = crc32 == row_crc((place, anchor))
        if is_sound and anchor is None:
            links.add_first(place)
        elif is_sound and isinstance(anchor, int) and 0 <= anchor < place:
            links.add(place, anchor)
        else:
            damaged += 1
    return damaged


def write_links(database: Database, rows: Sequence[Row]) -> None:
    """Write links, in a transaction that is begun."""
    database.rows(FURTHER['links'].replace('TABLE', 'TABLE IF NOT EXISTS', 1))
    for row in rows:
        database.rows('INSERT OR REPLACE INTO links VALUES (?, ?, ?)', (*row, row_crc(row)))


def takes_links(database: Database) -> bool:
    """Return whether a file takes further links: not if their table cannot be read."""
    try:
        return not database.has('links') or database.number('SELECT count(*) FROM links') >= 0
    except sqlite3.DatabaseError:
        database.roll_back()
        return False


def carry_links(every: Sequence[tuple[ReferenceMap, int]], links: Links) -> None:
    """
    Link the places of a map, given as those of other maps, as they are linked there.

    Where an anchor stays out, the earliest of its looks takes its part. What comes from another
    map than the first place is to be looked up among what comes before it.
    """
    firsts = dict[tuple[int, int], int]()
    for new, (own, at) in enumerate(every):
        if own.links.known:
            first = firsts.setdefault((id(own), own.links.anchor(at)), new)
            if first != new:
                links.add(new, first)
            elif own is every[0][0] and own.links.knows(at):
                links.add_first(new)
