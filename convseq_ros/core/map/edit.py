# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps made of the sessions of other maps, or of some of their places; all is kept as stored."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from itertools import pairwise
from operator import attrgetter
from pathlib import Path

from convseq_ros.core.graph.links import beyond, Links
from convseq_ros.core.map.crash_recovery import open_to_write
from convseq_ros.core.map.database import Database, explained, MapLock
from convseq_ros.core.map.format import kept_of, MapSession, row_crc
from convseq_ros.core.map.online import Looks
from convseq_ros.core.map.place import Picture, Places
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.writer import Progress, save_map, write_links
from convseq_ros.core.types import Pose
from convseq_ros.errors import MapError


@dataclass(frozen=True, slots=True)
class SessionSlice:
    """A session of a map, or some of its places, to be put into another map."""

    path: Path  # of the map
    reference_map: ReferenceMap
    number: int  # of the session in it
    session: MapSession  # what is to be stored of it
    places: Sequence[int]  # that it has in its map, ascending
    poses: Mapping[int, Pose] = field(default_factory=dict)  # by place, instead of its own


def slices_of(path: Path, opened: ReferenceMap | None = None) -> list[SessionSlice]:
    """
    Return the sessions of a map that have places; those without a name are called after its file.

    MapError as of `open_map`, unless it is open already.
    """
    whole, slices = open_map(path) if opened is None else opened, []
    for start, end in pairwise([*whole.bounds.starts.tolist(), len(whole)]):
        if start < end:
            number = whole.places[start].session
            session = whole.sessions[number]
            usual = path.stem if len(whole.sessions) == 1 else f'{path.stem}-{number + 1}'
            session = replace(session, name=session.name or usual)
            slices.append(SessionSlice(path, whole, number, session, range(start, end)))
    return slices


def chosen_slice(slices: Sequence[SessionSlice], wanted: str) -> SessionSlice:
    """Return the session of a name, an id or a number; MapError, naming all, if none is."""
    for key in map(attrgetter, ('session.name', 'session.id', 'number')):
        found = [one for one in slices if str(key(one)) == wanted]
        if len(found) == 1:
            return found[0]
    known = ', '.join(f'{one.number} {one.session.name!r}' for one in slices)
    raise MapError(f'{slices[0].path}: no one session is {wanted!r}; it has {known}')


def joined(slices: Sequence[SessionSlice]) -> ReferenceMap:
    """
    Return sessions as one map, in their order, which is in memory and reads their files.

    MapError if they were made with different settings or one is there twice.
    """
    _refuse_unlike(slices)
    first = slices[0].reference_map
    every = [(one.reference_map, at) for one in slices for at in one.places]
    places = Places(first.global_descriptors.shape[1], len(every))
    for number, one in enumerate(slices):
        for at in one.places:
            place = one.reference_map.places[at]
            place = replace(place, pose=one.poses.get(at, place.pose), session=number)
            places.append(place, one.reference_map.global_descriptors[at])

    def read(wanted: Sequence[int], with_images: bool) -> list[Picture]:
        found, of_map = dict[int, Picture](), dict[ReferenceMap, list[int]]()
        for one in wanted:
            of_map.setdefault(every[one][0], []).append(one)
        for own, some in of_map.items():
            pictures = own.pictures([every[one][1] for one in some], with_images)
            found.update(zip(some, pictures, strict=True))
        return [found[one] for one in wanted]

    sessions = [one.session for one in slices]
    made = ReferenceMap(first.encoding, places, read, first.keyframes, sessions=sessions)
    carry_links(every, made.links)
    return made


def _refuse_unlike(slices: Sequence[SessionSlice]) -> None:
    """Raise MapError if sessions were made with different settings, or one is there twice."""

    def settings(one: SessionSlice) -> dict[str, object]:
        return kept_of(one.reference_map.encoding) | one.reference_map.keyframes.spacing

    first, seen = slices[0], dict[str, SessionSlice]()
    expected = settings(first)
    for one in slices:
        made = settings(one)
        if unlike := [name for name in expected if made[name] != expected[name]]:
            name = unlike[0]
            raise MapError(
                f'{one.path}: made with {name} {made[name]!r:.40}, {first.path} with '
                f'{expected[name]!r:.40}; build one of them again with the settings of the other'
            )
        if before := seen.get(one.session.id):
            raise MapError(
                f'{one.path}: its session {one.session.name!r} is in {before.path} already, by '
                f'its id {one.session.id}; a map holds a session once: leave one out'
            )
        seen[one.session.id] = one


def carry_links(every: Sequence[tuple[ReferenceMap, int]], links: Links) -> None:
    """
    Link the places of a map, given as those of other maps, as they are linked there.

    Where the other place stays out, a link goes past it to what that one is linked to; and where
    an anchor stays out, the earliest of its looks takes its part. What comes from another map than
    the first place is to be looked up among what comes before it.
    """
    firsts, news = dict[tuple[ReferenceMap, int], int](), dict[tuple[ReferenceMap, int], int]()
    for new, (own, at) in enumerate(every):
        news[own, at] = new
        if not own.links.known:
            continue
        first = firsts.setdefault((own, own.links.anchor(at)), new)
        link = own.links.details(at)
        while link and (own, link.other) not in news:
            onward = own.links.details(link.other)
            link = onward and beyond(link, onward)
        if link:
            other = news[own, link.other]
            links.add(new, other, link.confidence, link.inliers, link.relative, first)
        elif first != new:
            links.add(new, first)
        elif own is every[0][0] and own.links.knows(at):
            links.add_first(new)


def write_new(
    whole: ReferenceMap, path: Path, progress: Progress = iter, instead: ReferenceMap | None = None
) -> None:
    """
    Write a map, whole or not at all, to a file that is not there, or that still holds `instead`.

    MapError if it is there, was changed since, another program adds to it, or the disk is full.
    """

    def refuse() -> None:
        if instead is None:
            refuse_existing(path)
        elif _state(open_map(path)) != _state(instead):
            raise MapError(f'{path}: was changed meanwhile; run it again')

    save_map(whole, path, progress, refuse)


def refuse_existing(path: Path) -> None:
    """Raise MapError if there is a file already, where a new one should be."""
    if path.exists():
        raise MapError(f'{path}: exists already; name another file')


def _state(whole: ReferenceMap) -> object:
    return whole.map_id, len(whole), [session.row for session in whole.sessions]


def without(slices: Sequence[SessionSlice], indices: Collection[int]) -> list[SessionSlice]:
    """Return the sessions of one map without some of its places."""
    out = {*indices}
    left = [replace(one, places=[at for at in one.places if at not in out]) for one in slices]
    return [one for one in left if one.places]


def limited(path: Path, whole: ReferenceMap, max_looks: int) -> ReferenceMap:
    """Return a map that keeps so many looks of each place: itself, if it has no more."""
    out = Looks(whole, max_looks).surplus
    return joined(without(slices_of(path, whole), out)) if out else whole


def bound(path: Path, max_looks: int, progress: Progress = iter) -> int:
    """
    Keep so many looks of each place in a map file; return how many places went.

    That is done in one step, or not at all; MapError as for `write_new`.
    """
    whole = open_map(path)
    left = limited(path, whole, max_looks)
    if left is not whole:
        write_new(left, path, progress, whole)
    return len(whole) - len(left)


def rename_session(named: SessionSlice) -> None:
    """Give a session the name of a slice, in its file; MapError if another program adds to it."""
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
    Take links out of a map file, and return how many; MapError if another program adds to it.

    Some `places` count as looked up from then on, and are not linked again; by default all links
    go, and places count as not looked up.
    """
    with _changed(path) as database:
        whole = open_map(path)
        before, left = len(whole.links), Links(whole.bounds.around)
        if places is None:
            database.rows('DELETE FROM links')
            return before
        for one in whole.links.each():
            if one.place in places:
                left.add_first(one.place)
            else:
                left.add(one.place, one.other, one.confidence, one.inliers, one.relative)
        write_links(database, left.since(0, len(whole)))
    return before - len(left)


@contextmanager
def _changed(path: Path) -> Iterator[Database]:
    """Give a map's file to be changed in one transaction."""
    with MapLock(path), explained(path), closing(open_to_write(path)) as database:
        with database.transaction('IMMEDIATE'):
            yield database
