# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Building a map from frames, and linking one that is there: online mode, for the map alone."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Self

from convseq_ros.config import Config, EVERY_FRAME, MotionConfig
from convseq_ros.core.encoding.descriptor import whole_descriptor
from convseq_ros.core.encoding.first_stage import Describe, with_first_stage
from convseq_ros.core.frame_gate import AnyOrder
from convseq_ros.core.map.online import link, OnlineMap
from convseq_ros.core.map.place import Places
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.session import Autosave, NoAutosave
from convseq_ros.core.types import Descriptor, Frame, Match

# Places are keyframes, one and all.
_STILL = MotionConfig(stationary_overlap=1.0, stationary_m=0.0)


class MapBuilder:
    """
    Adds the keyframes among some frames to a map file; use it as a context manager.

    Places are those that online mode makes of the same frames; they are one session, which may
    have a `name`, and its poses a `frame` that others share. What was added is safe after half a
    second, and at the end, also when the work was interrupted. A new file is made unless `append`;
    no path makes a map in memory. MapError if a new file exists already, an existing one is
    missing, damaged, made with other settings or added to by another, or the disk is full.

    Each place is recognised among those before it, as online mode does, for the map's `links`;
    without them, or without cells, nothing is recognised. All keyframes are kept, unless there is
    a limit of `max_looks`. `describe`, from an image to a vector, is the model of the map, if not
    what is built in.
    """

    def __init__(
        self,
        path: Path | None = None,
        config: Config = Config(),
        append: bool = False,
        name: str = '',
        frame: str = '',
        links: bool = True,
        max_looks: int = 0,
        describe: Describe | None = None,
    ) -> None:
        config = with_first_stage(config, describe)
        online = replace(config.online, mode='online', max_looks=max_looks)
        config = replace(config, online=online)
        encoding, keyframes = config.encoding, config.keyframes
        if path:
            self._autosave: NoAutosave = Autosave(
                path, encoding, keyframes, append, False, max_looks
            )
        else:
            self._autosave = NoAutosave(ReferenceMap(encoding, keyframes=keyframes))
        self.reference_map = self._autosave.reference_map
        self._recognizer = own = PlaceRecognizer(self.reference_map, config, describe=describe)
        # Whatever the stamps say, it is one session.
        own.order, own.mapping = AnyOrder(), OnlineMap(self.reference_map, config, name, frame)
        own.only_maps = not (links and encoding.keeps_cells)

    @property
    def added(self) -> int:
        """Places that were added."""
        return len(self.reference_map) - self._recognizer.mapping.session_start

    @property
    def removed(self) -> int:
        """Places that went at the end, for the limit."""
        return self._autosave.removed

    def process(self, frame: Frame) -> bool:
        """Take in the next frame; return whether it became a place. Unreadable ones never do."""
        before = len(self.reference_map)
        self._recognizer.process(frame)
        self._autosave.save()
        return len(self.reference_map) > before

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._autosave.close()


def build_map(
    frames: Iterable[Frame],
    path: str | Path | None = None,
    config: Config = Config(),
    links: bool = True,
    describe: Describe | None = None,
) -> ReferenceMap:
    """Build a map of frames in order, in a new file or in memory alone; as `MapBuilder` does."""
    file = Path(path) if path else None
    with MapBuilder(file, config, links=links, describe=describe) as builder:
        for frame in frames:
            builder.process(frame)
    return builder.reference_map


def not_linked(whole: ReferenceMap) -> list[range]:
    """Return the places of each session some of which were not looked up before, by cells."""
    if not whole.encoding.keeps_cells:
        return []
    ends = pairwise([*whole.bounds.starts.tolist(), len(whole)])
    return [range(*of) for of in ends if not all(map(whole.links.is_looked_up, range(*of)))]


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
