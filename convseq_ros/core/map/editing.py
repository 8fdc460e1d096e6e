# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps made of the sessions of other maps; places are copied as they are stored."""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from itertools import accumulate, pairwise
from pathlib import Path

from convseq_ros.config import EncodingConfig, KeyframeConfig
from convseq_ros.core.graph.links import Links
from convseq_ros.core.map.database import Database, explained
from convseq_ros.core.map.format import kept_of, MapSession, row_crc
from convseq_ros.core.map.link_rows import carry_links, write_links
from convseq_ros.core.map.lock import MapLock
from convseq_ros.core.map.opening import open_to_write
from convseq_ros.core.map.place import Picture, Places
from convseq_ros.core.map.reader import MapReader
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.replacing import replaced
from convseq_ros.core.map.writer import AT_ONCE, MapWriter
from convseq_ros.core.types import Pose
from convseq_ros.errors import MapError

Watch = Callable[[Sequence[int]], Iterable[int]]  # yields what it is given, and shows how far

_MOST_SAID = 40  # characters of a setting; a mask has thousands


@dataclass(frozen=True, slots=True)
class Part:
    """A session of a map, or some of its places, to be put into another map."""

    path: Path  # of the map
    reference_map: ReferenceMap
    number: int  # of the session in it
    session: MapSession  # what is to be stored of it
    places: Sequence[int]  # that it has in its map, ascending
    poses: Mapping[int, Pose] = field(default_factory=dict)  # by place, instead of its own

    @property
    def name(self) -> str:
        """What it is called."""
        return self.session.name


def parts_of(
    path: Path, encoding: EncodingConfig | None = None, keyframes: KeyframeConfig | None = None
) -> list[Part]:
    """Return the sessions of a map file that have places; settings and errors of `MapReader`."""
    opened = MapReader(path, encoding, keyframes).reference_map()
    called = names(opened.sessions, path.stem)
    parts = []
    for start, end in pairwise([*opened.bounds.starts.tolist(), len(opened)]):
        if start < end:
            number = opened.places[start].session
            session = replace(opened.sessions[number], name=called[number])
            parts.append(Part(path, opened, number, session, range(start, end)))
    return parts


def names(sessions: Sequence[MapSession], usual: str) -> list[str]:
    """Return what sessions are called; those without a name after their map."""
    nameless = [number for number, one in enumerate(sessions) if not one.name]
    ends = [''] if len(nameless) == 1 else [f'-{number + 1}' for number in nameless]
    found = [one.name for one in sessions]
    for number, end in zip(nameless, ends, strict=True):
        found[number] = f'{usual}{end}'
    return found


def chosen_part(parts: Sequence[Part], said: str) -> Part:
    """Return the session of a name, an id or a number; MapError, naming all, if none is."""
    for key in ('name', 'id'):
        found = [part for part in parts if getattr(part.session, key) == said]
        if len(found) == 1:
            return found[0]
    numbered = [part for part in parts if str(part.number) == said]
    if not numbered:
        known = ', '.join(f'{part.number} {part.name!r}' for part in parts)
        raise MapError(f'{parts[0].path}: no one session is {said!r}; it has {known}')
    return numbered[0]


def refuse_unlike(parts: Sequence[Part]) -> None:
    """Raise MapError if parts were made with different settings, or one of them is there twice."""
    first, seen = parts[0], dict[str, Part]()
    for part in parts:
        made = _settings(part.reference_map)
        for name, wanted in _settings(first.reference_map).items():
            if made[name] != wanted:
                told = (f'{str(one)[:_MOST_SAID]!r}' for one in (made[name], wanted))
                raise MapError(
                    f'{part.path}: made with {name} {next(told)}, {first.path} with '
                    f'{next(told)}; build one of them again with the settings of the other'
                )
        if before := seen.get(part.session.id):
            raise MapError(
                f'{part.path}: its session {part.name!r} is in {before.path} already, by its id '
                f'{part.session.id}; a map holds a session once: leave one out'
            )
        seen[part.session.id] = part


def _settings(reference_map: ReferenceMap) -> dict[str, object]:
    """Return what makes a map's places, by name."""
    return kept_of(reference_map.encoding) | reference_map.keyframes.spacing


def write_parts(parts: Sequence[Part], path: Path, watch: Watch, replaces: bool = False) -> int:
    """
    Write sessions as one map, in their order, whole or not at all; return its places.

    MapError if they were made with different settings or one is there twice, if there is a map
    of this name already, unless it `replaces` that one, of which the parts are and which nobody
    changed since, or if another program adds to it or the disk is full.
    """
    whole = _whole(parts)
    with replaced(path) as part_file:
        if replaces:
            _refuse_changed(path, parts[0].reference_map)
        elif path.exists():
            raise MapError(f'{path}: exists already; name another file')
        with MapWriter(part_file, whole.encoding, whole.keyframes) as writer:
            writer.append(whole, 0)
            for start in watch(range(0, len(whole), AT_ONCE)):
                writer.append(whole, min(start + AT_ONCE, len(whole)))
        return writer.committed


def _refuse_changed(path: Path, read: ReferenceMap) -> None:
    """Raise MapError if a file is no longer what was read; for who holds its lock."""
    now = MapReader(path).reference_map()
    was, is_ = (
        (one.map_id, len(one), [session.row for session in one.sessions]) for one in (read, now)
    )
    if was != is_:
        raise MapError(f'{path}: was changed meanwhile; run it again')


def joined(parts: Sequence[Part]) -> list[Part]:
    """
    Return sessions as those of one map, in their order, which is in memory and reads their files.

    It is what `write_parts` would write. MapError if they were made with different settings or one
    is there twice.
    """
    whole, ends = _whole(parts), [*accumulate(len(part.places) for part in parts)]
    return [
        replace(part, reference_map=whole, number=number, places=range(start, end), poses={})
        for number, (part, (start, end)) in enumerate(
            zip(parts, pairwise([0, *ends]), strict=True)
        )
    ]


def _whole(parts: Sequence[Part]) -> ReferenceMap:
    refuse_unlike(parts)
    own = parts[0].reference_map
    every = [(part.reference_map, at) for part in parts for at in part.places]
    places = Places(own.global_descriptors.shape[1], len(every))
    for number, part in enumerate(parts):
        for at in part.places:
            place = part.reference_map.places[at]
            place = replace(place, pose=part.poses.get(at, place.pose), session=number)
            places.append(place, part.reference_map.global_descriptors[at])

    def read(wanted: Sequence[int], with_images: bool) -> list[Picture]:
        found, of_map = dict[int, Picture](), dict[int, list[int]]()
        for one in wanted:
            of_map.setdefault(id(every[one][0]), []).append(one)
        for some in of_map.values():
            from_file = every[some[0]][0]
            pictures = from_file.pictures([every[one][1] for one in some], with_images)
            found.update(zip(some, pictures, strict=True))
        return [found[one] for one in wanted]

    sessions = [part.session for part in parts]
    made = ReferenceMap(own.encoding, places, read, own.keyframes, sessions=sessions)
    carry_links(every, made.links)
    return made


def rename_session(part: Part) -> None:
    """Give a session the name of a part, in its file; MapError if another program adds to it."""
    row = part.number, *part.session.row
    with _changed(part.path) as database:
        database.rows(
            'UPDATE sessions SET name = ?, crc32 = ? WHERE session = ? AND id = ?',
            (part.name, row_crc(row), part.number, part.session.id),
        )
        if not database.number('SELECT changes()'):
            raise MapError(f'{part.path}: was changed meanwhile; run it again')


def unlink(path: Path, places: Collection[int] | None = None) -> int:
    """
    Take links out of a map file, and return how many; MapError if another program adds to it.

    Some `places` count as looked up from then on, and are not linked again; by default all links
    go, and places count as not looked up.
    """
    with _changed(path) as database:
        whole = MapReader(path).reference_map()
        before = len(whole.links)
        if not database.has('links'):
            return 0
        if places is None:
            database.rows('DELETE FROM links')
            return before
        left = Links(whole.bounds.around)
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
