# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Links of a map that has none: its places are recognised as those of a drive are."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

from convseq_ros.config import Config, EVERY_FRAME, MotionConfig
from convseq_ros.core.encoding.descriptor import whole_descriptor
from convseq_ros.core.frame_gate import AnyOrder
from convseq_ros.core.map.online import link, OnlineMap
from convseq_ros.core.map.place import Places
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.types import Descriptor, Frame, Match

# Places are keyframes, one and all.
_STILL = MotionConfig(stationary_overlap=1.0, stationary_m=0.0)


def not_linked(whole: ReferenceMap) -> list[range]:
    """Return the places of each session some of which were not looked up before, by cells."""
    if not whole.encoding.keeps_cells:
        return []
    ends = pairwise([*whole.bounds.starts.tolist(), len(whole)])
    return [range(*of) for of in ends if not all(map(whole.links.knows, range(*of)))]


def link_map(
    whole: ReferenceMap, config: Config = Config(), sessions: Sequence[range] | None = None
) -> Iterator[int]:
    """
    Look up the places of sessions, those `not_linked`, in what comes before them; yield each.

    It goes by what the map keeps of them, of which every region counts as salient; else it is what
    online mode does on these drives. Others may use the map meanwhile.
    """
    sessions = not_linked(whole) if sessions is None else sessions
    if not sessions:
        return
    seen = _as_driven(whole)
    online = replace(config.online, mode='online')
    config = replace(config, encoding=seen.encoding, motion=_STILL, online=online)
    recognizer, mapping = PlaceRecognizer(seen, config), _DrivenMap(seen, config)
    recognizer.order, recognizer.mapping = AnyOrder(), mapping
    for session in sessions:
        recognizer.reset()
        mapping.begin(session.start)
        for index in session:
            recognizer.process(*_asked(whole, index))
            yield index


class _DrivenMap(OnlineMap):
    """Has the places of a map passed again, in their order; they are there, and none is added."""

    def begin(self, start: int) -> None:
        """Begin a session of the map, at its first place."""
        self.reset()
        self.session_start = self._usable = start

    def add(self, _frame: Frame, _descriptor: Descriptor, _match: Match | None = None) -> None:
        """Pass the next place, and link it as it was recognised."""
        link(self._map.links, self.session_start + len(self._passed_m), _match)
        self._passed_m.append(self._travelled_m)


def _as_driven(whole: ReferenceMap) -> ReferenceMap:
    """Return a map as it is now, with its links, whose places are upright and keyframes each."""
    places, end = Places(whole.global_descriptors.shape[1], len(whole)), len(whole)
    places.descriptors.extend(whole.global_descriptors[:end])
    places.take({name: rows[:end] for name, rows in whole.places.columns.items()}, 0)
    encoding = replace(whole.encoding, image_rotation_deg=0)
    seen = ReferenceMap(
        encoding, places, whole.pictures, EVERY_FRAME, whole.map_id, whole.sessions
    )
    seen.links = whole.links
    return seen


def _asked(whole: ReferenceMap, index: int) -> tuple[Frame, Descriptor]:
    """Return a place as what a drive sees."""
    place = whole.places[index]
    camera = whole.sessions[place.session].camera
    frame = Frame(place.stamp_ns, None, place.source, place.pose, camera=camera)
    descriptor = whole_descriptor(whole.cells(index))
    if whole.encoding.descriptor_model:
        descriptor = replace(descriptor, vector=whole.global_descriptors[index])
    return frame, descriptor
