# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Editing map files: each edit but a rename writes a new file, and puts it in place of the old."""

from collections.abc import Collection
from contextlib import closing
from pathlib import Path

from convseq_ros.core.map.crash_recovery import open_to_write
from convseq_ros.core.map.database import as_map_error
from convseq_ros.core.map.format import row_crc
from convseq_ros.core.map.lock import MapLock
from convseq_ros.core.map.pruning import Pruning
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.session_slice import joined, SessionSlice, slices_of, without
from convseq_ros.core.map.writer import rewrite
from convseq_ros.errors import MapError


def pruned(path: Path, opened: ReferenceMap, max_looks: int) -> ReferenceMap:
    """Return a map with at most `max_looks` stretches of a place: the same if it has no more."""
    surplus = Pruning(opened, max_looks).surplus
    return joined(without(slices_of(path, opened), surplus)) if surplus else opened


def prune_looks(path: Path, max_looks: int) -> int:
    """
    Keep at most `max_looks` stretches of each place in a map file; return how many places it lost.

    MapError as for `rewrite`.
    """
    lost = 0

    def change(opened: ReferenceMap) -> ReferenceMap | None:
        nonlocal lost
        after = pruned(path, opened, max_looks)
        lost = len(opened) - len(after)
        return after if lost else None

    rewrite(path, change)
    return lost


def rename_session(named: SessionSlice) -> None:
    """Write the name of a slice's session to its file; MapError if another program adds to it."""
    row, path = (named.number, *named.session.row), named.path
    with MapLock(path), as_map_error(path), closing(open_to_write(path)) as database:
        database.rows(
            'UPDATE sessions SET name = ?, crc32 = ? WHERE session = ? AND id = ?',
            (named.session.name, row_crc(row), named.number, named.session.id),
        )
        if not database.number('SELECT changes()'):
            raise MapError(f'{named.path}: was changed meanwhile; run it again')


def unlink(path: Path, places: Collection[int] | None = None) -> int:
    """
    Remove links from a map file; return how many. MapError as for `rewrite`.

    With `places`, only their links are removed; they stay marked as looked up and are not linked
    again, not even after `forget_links`. By default all links and all marks are removed.
    """
    removed = 0

    def change(opened: ReferenceMap) -> ReferenceMap:
        nonlocal removed
        links, left = opened.take_links(), opened.links
        for place, link, is_unlinked in links.since(0, len(opened) if places else 0):
            if is_unlinked or (link and places and place in places):
                left.add_unlinked(place)
            elif link:
                left.add(place, link.other, link.confidence, link.inliers, link.relative)
            else:
                left.add_first(place)
        removed = len(links) - len(left)
        return opened

    rewrite(path, change)
    return removed


def forget_links(opened: ReferenceMap) -> None:
    """Remove all links of a map, to be linked anew; places that a person unlinked stay so."""
    links = opened.take_links()
    for place in filter(links.is_unlinked, range(len(opened))):
        opened.links.add_unlinked(place)
