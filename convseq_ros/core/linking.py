# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Links between the sessions of a map: each is recognised in the others as a later drive is."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from convseq_ros.config import Config, EVERY_FRAME, MotionConfig
from convseq_ros.core.encoding.descriptor import whole_descriptor
from convseq_ros.core.map.place import Picture, Places
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.types import Frame, Match, RelativePose


@dataclass(frozen=True, eq=False, slots=True)
class Link:
    """Two places of different sessions that show the same."""

    place: int  # of the map
    other: int  # the place that it was recognised as
    confidence: float | None  # probability in [0, 1] that it is, if that is known
    inliers: int | None
    relative: RelativePose | None  # of the base at the place, against the other's; if measured


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


def recognised(whole: ReferenceMap, session: int) -> Iterator[tuple[int, Match]]:
    """
    Yield the places of a session, by their index, and what the other sessions say of each.

    The places are the frames of a drive, in their order, with what the map keeps of them: every
    region counts as salient. Indices in matches are those of the others alone.
    """
    own = [index for index, place in enumerate(whole.places) if place.session == session]
    others = selected(whole, _others(whole, session))
    still = MotionConfig(stationary_overlap=1.0, stationary_m=0.0)
    config = Config(encoding=others.encoding, motion=still)
    recognizer = PlaceRecognizer(others, config)
    for index in own:
        place = whole.places[index]
        camera = whole.sessions[session].camera
        frame = Frame(place.stamp_ns, None, place.source, place.pose, camera=camera)
        yield index, recognizer.process(frame, whole_descriptor(whole.cells(index)))


def _others(whole: ReferenceMap, session: int) -> list[int]:
    return [index for index, place in enumerate(whole.places) if place.session != session]


def links_of(whole: ReferenceMap, session: int) -> Iterator[Link | None]:
    """Yield for each place of a session its link to another session, if it is recognised."""
    others = _others(whole, session)
    for index, match in recognised(whole, session):
        if (found := match.accepted) is None:
            yield None
            continue
        other, relative = others[found.reference_index], match.relative_pose
        yield Link(index, other, match.confidence, found.inliers, relative)
