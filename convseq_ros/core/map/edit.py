# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Editing maps: joining sessions, removing places, renaming sessions, removing links."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from itertools import pairwise
from operator import attrgetter
from pathlib import Path

from convseq_ros.core.graph.links import chained, Links
from convseq_ros.core.map.arrays import Places
from convseq_ros.core.map.crash_recovery import open_to_write
from convseq_ros.core.map.database import as_map_error, Database, MapLock
from convseq_ros.core.map.format import MapSession, row_crc, stored_settings, TABLES
from convseq_ros.core.map.place import Picture
from convseq_ros.core.map.pruning import Pruning
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.writer import Progress, save_map, write_links
from convseq_ros.core.types import Pose
from convseq_ros.errors import MapError


@dataclass(frozen=True, slots=True)
class SessionSlice:
    """A session of a map, or a part of it, to be copied into another map."""

    path: Path  # of the map
    reference_map: ReferenceMap
    number: int  # of the session in its map
    session: MapSession  # the session's row to store
    places: Sequence[int]  # indices in its map, ascending
    poses: Mapping[int, Pose] = field(default_factory=dict)  # by place: replace the map's poses


def slices_of(path: Path, opened: ReferenceMap | None = None) -> list[SessionSlice]:
    """
    Return the sessions of a map that have places; a session without a name gets the file's name.

    `opened` is the map, if it is open already; else MapError as of `open_map`.
    """
    reference_map, slices = open_map(path) if opened is None else opened, []
    for start, end in pairwise([*reference_map.bounds.starts.tolist(), len(reference_map)]):
        if start < end:
            number, count = reference_map.places[start].session, len(reference_map.sessions)
            session = reference_map.sessions[number]
            default_name = path.stem if count == 1 else f'{path.stem}-{number + 1}'
            session = replace(session, name=session.name or default_name)
            slices.append(SessionSlice(path, reference_map, number, session, range(start, end)))
    return slices


def chosen_slice(slices: Sequence[SessionSlice], wanted: str) -> SessionSlice:
    """Return the session with a name, an id or a number; MapError, naming all, without one."""
    for key in map(attrgetter, ('session.name', 'session.id', 'number')):
        matching = [part for part in slices if str(key(part)) == wanted]
        if len(matching) == 1:
            return matching[0]
    choices = ', '.join(f'{part.number} {part.session.name!r}' for part in slices)
    raise MapError(f'{slices[0].path}: no single session is {wanted!r}; it has {choices}')


def joined(slices: Sequence[SessionSlice]) -> ReferenceMap:
    """
    Return a map of the sessions in order; it is in memory and reads pictures from their files.

    MapError if they were made with different settings or a session is there twice.
    """
    _refuse_incompatible(slices)
    first = slices[0].reference_map
    origins = [(part.reference_map, index) for part in slices for index in part.places]
    places = Places(first.global_descriptors.shape[1], len(origins))
    for number, part in enumerate(slices):
        for index in part.places:
            place = part.reference_map.places[index]
            place = replace(place, pose=part.poses.get(index, place.pose), session=number)
            places.append(place, part.reference_map.global_descriptors[index])

    def read(indices: Sequence[int], with_images: bool) -> list[Picture]:
        pictures, by_map = dict[int, Picture](), dict[ReferenceMap, list[int]]()
        for index in indices:
            by_map.setdefault(origins[index][0], []).append(index)
        for source, wanted in by_map.items():
            read_now = source.pictures([origins[index][1] for index in wanted], with_images)
            pictures.update(zip(wanted, read_now, strict=True))
        return [pictures[index] for index in indices]

    sessions = [part.session for part in slices]
    joined_map = ReferenceMap(first.encoding, places, read, first.keyframes, sessions=sessions)
    carry_links(origins, joined_map.links)
    return joined_map


def _refuse_incompatible(slices: Sequence[SessionSlice]) -> None:
    """Raise MapError if sessions were made with different settings, or one is there twice."""

    def settings_of(part: SessionSlice) -> dict[str, object]:
        return stored_settings(part.reference_map.encoding) | part.reference_map.keyframes.spacing

    first, known = slices[0], dict[str, SessionSlice]()
    expected = settings_of(first)
    for part in slices:
        settings = settings_of(part)
        if different := [name for name in expected if settings[name] != expected[name]]:
            name = different[0]
            raise MapError(
                f'{part.path}: made with {name} {settings[name]!r:.40}, {first.path} with '
                f'{expected[name]!r:.40}; build one of them again with the settings of the other'
            )
        if before := known.get(part.session.id):
            raise MapError(
                f'{part.path}: its session {part.session.name!r} is in {before.path} already, by '
                f'its id {part.session.id}; a map holds a session once: leave one out'
            )
        known[part.session.id] = part


def carry_links(origins: Sequence[tuple[ReferenceMap, int]], links: Links) -> None:
    """
    Copy links to a new map, whose places are given by their maps and their indices there.

    If the other place of a link is left out, the link leads to the place that the other one is
    linked to. If an anchor is left out, its earliest look becomes the anchor. Anchors of maps
    other than the first place's are not marked as looked up, so that `link_map` looks them up.
    """
    anchors, copies = dict[tuple[ReferenceMap, int], int](), dict[tuple[ReferenceMap, int], int]()
    for new, (source, old) in enumerate(origins):
        copies[source, old] = new
        if not source.links.looked_up_count:
            continue
        anchor = anchors.setdefault((source, source.links.anchor(old)), new)
        link = source.links.details(old)
        while link and (source, link.other) not in copies:
            onward = source.links.details(link.other)
            link = onward and chained(link, onward)
        if link:
            other = copies[source, link.other]
            links.add(new, other, link.confidence, link.inliers, link.relative, anchor)
        elif anchor != new:
            links.add(new, anchor)
        elif source.links.is_unlinked(old):
            links.add_unlinked(new)
        elif source is origins[0][0] and source.links.is_looked_up(old):
            links.add_first(new)


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


def without(slices: Sequence[SessionSlice], indices: Collection[int]) -> list[SessionSlice]:
    """Return the sessions of a map without the places of given indices."""
    gone = {*indices}
    left = [replace(part, places=[at for at in part.places if at not in gone]) for part in slices]
    return [part for part in left if part.places]


def pruned(path: Path, opened: ReferenceMap, max_looks: int) -> ReferenceMap:
    """Return a map with at most `max_looks` looks of a place: the same map if it has no more."""
    surplus = Pruning(opened, max_looks).surplus
    return joined(without(slices_of(path, opened), surplus)) if surplus else opened


def prune_looks(path: Path, max_looks: int, progress: Progress = iter) -> int:
    """
    Keep at most `max_looks` looks of each place in a map file; return how many places it lost.

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
        links = opened.links
        left = opened.links = Links(opened.bounds.around)
        for place, link, is_unlinked in links.since(0, len(opened)) if places is not None else ():
            if is_unlinked or (link and place in (places or ())):
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
        links = opened.links
        opened.links = Links(opened.bounds.around)
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
