# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Editing map files: writing new ones, removing places, renaming sessions, removing links."""

from collections.abc import Collection, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from convseq_ros.core.map.crash_recovery import open_to_write
from convseq_ros.core.map.database import as_map_error, Database
from convseq_ros.core.map.format import row_crc, TABLES
from convseq_ros.core.map.lock import MapLock
from convseq_ros.core.map.pruning import Pruning
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.session_slice import joined, SessionSlice, slices_of, without
from convseq_ros.core.map.writer import Progress, save_map, write_links
from convseq_ros.errors import MapError


def write_new(
    new: ReferenceMap, path: Path, progress: Progress = iter, instead: ReferenceMap | None = None
) -> None:
    """
    Write a map in one step to a new file, or to a file that still holds the map `instead`.

    MapError if a new file exists, a file was changed, another program adds, or the disk is full.
    """

    def refuse() -> None:
        if instead is None:
            refuse_existing(path)
        elif _state(open_map(path)) != _state(instead):
            raise MapError(f'{path}: was changed meanwhile; run it again')

    save_map(new, path, progress, refuse)


def refuse_existing(path: Path) -> None:
    """Raise MapError if a file that should be new exists already."""
    if path.exists():
        raise MapError(f'{path}: exists already; name another file')


def _state(saved: ReferenceMap) -> object:
    return saved.map_id, len(saved), [session.row for session in saved.sessions]


def pruned(path: Path, opened: ReferenceMap, max_looks: int) -> ReferenceMap:
    """Return a map with at most `max_looks` stretches of a place: the same if it has no more."""
    surplus = Pruning(opened, max_looks).surplus
    return joined(without(slices_of(path, opened), surplus)) if surplus else opened


def prune_looks(path: Path, max_looks: int, progress: Progress = iter) -> int:
    """
    Keep at most `max_looks` stretches of each place in a map file; return how many places it lost.

    The file is replaced in one step or not at all; MapError as for `write_new`.
    """
    before = open_map(path)
    after = pruned(path, before, max_looks)
    if after is not before:
        write_new(after, path, progress, before)
    return len(before) - len(after)


def keep_first(path: Path, count: int) -> None:
    """Remove all but the first places of a map file; MapError if another program adds to it."""
    with _changed(path) as database:
        for table, columns in TABLES.items():
            if 'reference_index' in columns:
                database.rows(f'DELETE FROM {table} WHERE reference_index >= ?', (count,))
        database.rows('DELETE FROM links WHERE place >= ?', (count,))
        last = 'SELECT coalesce(max(session), -1) FROM places'
        database.rows(f'DELETE FROM sessions WHERE session > ({last})')


def rename_session(named: SessionSlice) -> None:
    """Write the name of a slice's session to its file; MapError if another program adds to it."""
    row = named.number, *named.session.row
    with _changed(named.path) as database:
        database.rows(
            'UPDATE sessions SET name = ?, crc32 = ? WHERE session = ? AND id = ?',
            (named.session.name, row_crc(row), named.number, named.session.id),
        )
        if not database.number('SELECT changes()'):
            raise MapError(f'{named.path}: was changed meanwhile; run it again')


def unlink(path: Path, places: Collection[int] | None = None) -> int:
    """
    Remove links from a map file; return how many. MapError if another program adds to it.

    With `places`, only their links are removed; they stay marked as looked up and are not linked
    again, not even by `relinked`. By default all links and all marks are removed.
    """
    with _changed_links(path) as opened:
        links, left = opened.take_links(), opened.links
        if places is None:
            return len(links)
        for place, link, is_unlinked in links.since(0, len(opened)):
            if is_unlinked or (link and place in places):
                left.add_unlinked(place)
            elif link:
                left.add(place, link.other, link.confidence, link.inliers, link.relative)
            else:
                left.add_first(place)
    return len(links) - len(left)


@contextmanager
def relinked(path: Path) -> Iterator[ReferenceMap]:
    """
    Yield a map without links, to be linked anew; at the end they replace those of its file.

    Places that a person unlinked stay so. After an error, the file keeps its links. MapError if
    another program adds to it.
    """
    with _changed_links(path) as opened:
        links = opened.take_links()
        for place in filter(links.is_unlinked, range(len(opened))):
            opened.links.add_unlinked(place)
        yield opened


@contextmanager
def _changed_links(path: Path) -> Iterator[ReferenceMap]:
    """Yield a map whose links replace those of its file at the end, in one step."""
    with _changed(path) as database:
        opened = open_map(path)
        yield opened
        database.rows('DELETE FROM links')
        write_links(database, opened.links.since(0, len(opened)))


@contextmanager
def _changed(path: Path) -> Iterator[Database]:
    """Yield a map's file, opened to be changed in one transaction."""
    with MapLock(path), as_map_error(path), closing(open_to_write(path)) as database:
        with database.transaction('IMMEDIATE'):
            yield database
