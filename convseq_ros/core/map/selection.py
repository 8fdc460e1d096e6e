# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A part of a map, or parts of several, as a map that reads its places where they are."""

from collections.abc import Sequence
from dataclasses import replace

from convseq_ros.config import EVERY_FRAME
from convseq_ros.core.map.editing import Part, refuse_unlike, uses_of
from convseq_ros.core.map.place import Picture, Places
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.uses import Uses


def selected(whole: ReferenceMap, indices: Sequence[int]) -> ReferenceMap:
    """
    Return some places of a map, in their order, with all its sessions.

    Its queries are places of the same map: upright already, and a keyframe each.
    """
    places = Places(whole.cell_shape, len(indices))
    for index in indices:
        places.append(whole.places[index], whole.global_descriptors[index])

    def read(wanted: Sequence[int], with_images: bool) -> list[Picture]:
        return whole.pictures([indices[one] for one in wanted], with_images)

    encoding = replace(whole.encoding, image_rotation_deg=0)
    return ReferenceMap(encoding, places, read, EVERY_FRAME, whole.map_id, whole.sessions)


def joined(parts: Sequence[Part]) -> list[Part]:
    """
    Return sessions as those of one map, in their order, which is in memory and reads their files.

    It is what `write_parts` would write. MapError if they were made with different settings or one
    is there twice.
    """
    refuse_unlike(parts)
    own = parts[0].reference_map
    numbered = [(number, at) for number, part in enumerate(parts) for at in part.places]
    every = [(parts[number].reference_map, at) for number, at in numbered]
    places, ranges = Places(own.cell_shape, len(every)), list[range]()
    for number, part in enumerate(parts):
        ranges.append(range(len(places), len(places) + len(part.places)))
        descriptors = part.reference_map.global_descriptors
        for at in part.places:
            place = part.reference_map.places[at]
            place = replace(place, pose=part.poses.get(at, place.pose), session=number)
            places.append(place, descriptors[at])

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
    known = sessions, Uses(uses_of(parts, numbered))
    whole = ReferenceMap(own.encoding, places, read, own.keyframes, '', *known)
    return [
        replace(part, reference_map=whole, number=number, places=run, poses={})
        for number, (part, run) in enumerate(zip(parts, ranges, strict=True))
    ]
