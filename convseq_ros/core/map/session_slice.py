# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Slices of maps: sessions, or parts of them, from which a new map is joined."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from convseq_ros.core.graph.links import chained, Links
from convseq_ros.core.map.arrays import Places
from convseq_ros.core.map.format import MapSession, stored_settings
from convseq_ros.core.map.place import Picture
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Pose
from convseq_ros.errors import MapError, NO_PLACES


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
    for places in reference_map.session_ranges:
        number, count = reference_map.places[places.start].session, len(reference_map.sessions)
        session = reference_map.sessions[number]
        default_name = path.stem if count == 1 else f'{path.stem}-{number + 1}'
        session = replace(session, name=session.name or default_name)
        slices.append(SessionSlice(path, reference_map, number, session, places))
    return slices


def required_slices(path: Path, opened: ReferenceMap | None = None) -> list[SessionSlice]:
    """Return what `slices_of` does; MapError if the map has no places."""
    if slices := slices_of(path, opened):
        return slices
    raise MapError(f'{path}: {NO_PLACES}')


def chosen_slice(slices: Sequence[SessionSlice], wanted: str) -> SessionSlice:
    """Return the one session of a name, id or number; MapError, naming all, without it."""
    matching = [
        part for part in slices if wanted in (part.session.name, part.session.id, str(part.number))
    ]
    if len(matching) == 1:
        return matching[0]
    choices = ', '.join(f'{part.number} {part.session.name!r}' for part in slices)
    raise MapError(
        f'{slices[0].path}: no single session is {wanted!r}; it has {choices}; `convseq info` '
        'shows their ids'
    )


def joined(slices: Sequence[SessionSlice]) -> ReferenceMap:
    """
    Return a map of the sessions in order; it is in memory and reads pictures from their files.

    MapError if they were made with different settings or a session is there twice.
    """
    refuse_incompatible(slices)
    first = slices[0].reference_map
    origins = [(part.reference_map, index) for part in slices for index in part.places]
    places = Places(first.global_descriptors.shape[1], len(origins))
    for number, part in enumerate(slices):
        places.join(part.reference_map.places, part.places, number, part.poses)

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
    joined_map.keeps_images = any(part.reference_map.keeps_images for part in slices)
    joined_map.position_sigma_m = max(part.reference_map.position_sigma_m for part in slices)
    carry_links(origins, joined_map.links)
    for source in dict.fromkeys(part.reference_map for part in slices):
        kept = {part.session.id for part in slices if part.reference_map is source}
        kept -= {part.session.id for part in slices if part.poses}  # they replace odometry
        for keyframe in source.trail.since(0):
            if keyframe.session_id in kept:
                joined_map.trail.add(keyframe)
    return joined_map


def refuse_incompatible(slices: Sequence[SessionSlice]) -> None:
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


def without(slices: Sequence[SessionSlice], indices: Collection[int]) -> list[SessionSlice]:
    """Return the sessions of a map without the places of given indices."""
    gone = {*indices}
    left = [replace(part, places=[at for at in part.places if at not in gone]) for part in slices]
    return [part for part in left if part.places]
