# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Building a map from frames, and linking an existing map, both by means of online mode."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Self

from convseq_ros.config import Config, EVERY_FRAME, MotionConfig
from convseq_ros.core.encoding.descriptor import whole_descriptor
from convseq_ros.core.encoding.first_stage import Describe, with_first_stage
from convseq_ros.core.encoding.glance import brightness, Glance, glance
from convseq_ros.core.gate.gate import AnyOrder
from convseq_ros.core.map.appender import Appender, MapOwner
from convseq_ros.core.map.image_coding import decode_jpeg
from convseq_ros.core.map.online import link, OnlineMap
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.pose.camera_check import CameraCheck
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.types import Descriptor, Frame, Match

# Never stationary: every place of a map is a keyframe.
_NEVER_STILL = MotionConfig(stationary_glance=0.0, stationary_m=0.0)


class MapBuilder:
    """
    Adds the keyframes among frames to a map file; use it as a context manager.

    The places are those that online mode makes of the same frames. They are one session, which
    may have a `name`, and a reference `frame` of its poses. Places are safe on disk after half a
    second, and at the end, even if the work is interrupted. A new file is made unless `append`;
    without a path the map is in memory. MapError if a new file exists already, an existing one is
    missing, damaged, made with other settings or in use by another program, or the disk is full.

    With `links`, each place is matched with the earlier ones, as in online mode, and linked to
    those that it shows; without, nothing is recognised. All keyframes are kept
    unless `max_looks` limits the stretches of a place. `describe`, from an image to a vector, is
    the map's descriptor model, if any.
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
            self._owner: MapOwner = Appender(
                path, encoding, keyframes, append=append, keeps_empty=False, max_looks=max_looks
            )
        else:
            self._owner = MapOwner(ReferenceMap(encoding, keyframes=keyframes))
        self.reference_map = self._owner.reference_map
        self._recognizer = PlaceRecognizer(
            self.reference_map,
            config,
            describe=describe,
            mapping=OnlineMap(self.reference_map, config, name, frame, links),
            order=AnyOrder(),  # all frames are one session, whatever their stamps
        )

    @property
    def camera_check(self) -> CameraCheck:
        """What to say about the camera."""
        return self._recognizer.camera_check

    @property
    def added(self) -> int:
        """Number of places that were added."""
        return len(self.reference_map) - self._recognizer.mapping.session_start

    @property
    def removed(self) -> int:
        """Number of places that were removed at the end because of `max_looks`."""
        return self._owner.removed

    def process(self, frame: Frame) -> bool:
        """Process the next frame; return whether it became a place. Unreadable ones never do."""
        before = len(self.reference_map)
        self._recognizer.process(frame)
        self._owner.save()
        return len(self.reference_map) > before

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._owner.close()


def build_map(
    frames: Iterable[Frame],
    path: str | Path | None = None,
    config: Config = Config(),
    links: bool = True,
    describe: Describe | None = None,
) -> ReferenceMap:
    """
    Build a map from frames in order, in a new file or in memory.

    Parameters
    ----------
    frames : iterable of Frame
        One drive, in order; frames without an image are left out.
    path : str or Path, optional
        File to make; without it the map is in memory.
    config : Config
        Decides which frames become places, and how they are encoded.
    links : bool
        Whether each place is matched with the earlier ones, and linked to those that it shows;
        without, nothing is recognised, and `link_map` does it later.
    describe : Describe, optional
        Descriptor model of the map, from an image to a vector; none for the built-in one.

    Returns
    -------
    ReferenceMap
        The map, as `PlaceRecognizer` takes it.

    Raises
    ------
    MapError
        If the file exists already, cannot be written, or the disk is full.
    ModelError
        If the model fails on an image.

    """
    file = Path(path) if path else None
    with MapBuilder(file, config, links=links, describe=describe) as builder:
        for frame in frames:
            builder.process(frame)
    return builder.reference_map


def not_linked(unlinked: ReferenceMap) -> list[range]:
    """Return the places of each session with places not looked up yet."""
    known = unlinked.links.is_looked_up
    return [places for places in unlinked.session_ranges if not all(map(known, places))]


def link_map(unlinked: ReferenceMap, config: Config = Config()) -> Iterator[int]:
    """
    Look up the places of sessions `not_linked` among earlier ones, and link them; yield each.

    The results are those of online mode on the same drives, except that every region of a stored
    place counts as salient. Other threads may read the map meanwhile.
    """
    if not (sessions := not_linked(unlinked)):
        return
    driven = _as_driven(unlinked)
    online = replace(config.online, mode='online')
    config = replace(config, encoding=driven.encoding, motion=_NEVER_STILL, online=online)
    mapping = _DrivenMap(driven, config)
    recognizer = PlaceRecognizer(driven, config, mapping=mapping, order=AnyOrder())
    for session in sessions:
        recognizer.reset()
        mapping.begin(session.start)
        for index in session:
            recognizer.process(*_frame_of(unlinked, index))
            yield index


class _DrivenMap(OnlineMap):
    """A map whose places are passed again in order; they are linked, and none is added."""

    def begin(self, start: int) -> None:
        super().begin(start)
        self._next = start

    def follow(self, _edges: Glance | None, stamp_ns: int) -> None:
        """Take in the glance of the next place, by its thumbnail."""
        preview = decode_jpeg(self._map.thumbnail(self._next))
        super().follow(None if preview is None else glance(preview), stamp_ns)

    def add(self, _frame: Frame, _descriptor: Descriptor, _match: Match | None = None) -> None:
        """Link the next place to the one that its match recognises."""
        link(self._map.links, self._next, _match)
        self._passed_at.append(self._scenes.passed)
        self._next += 1


def _as_driven(source: ReferenceMap) -> ReferenceMap:
    """Return a copy that shares pictures and links, with every place as an upright keyframe."""
    places = source.places.first(len(source))
    encoding = replace(source.encoding, image_rotation_deg=0)
    same = source.map_id, source.sessions, source.links
    return ReferenceMap(encoding, places, source.pictures, EVERY_FRAME, *same)


def _frame_of(source: ReferenceMap, index: int) -> tuple[Frame, Descriptor]:
    """Return a place as a frame with its descriptor."""
    place = source.places[index]
    camera = source.sessions[place.session].camera
    frame = Frame(place.stamp_ns, None, place.source, place.pose, camera=camera)
    descriptor = whole_descriptor(source.cells(index))
    preview = decode_jpeg(source.thumbnail(index))
    light = None if preview is None else brightness(preview)
    descriptor = replace(descriptor, keypoints=source.keypoints(index), brightness=light)
    if source.encoding.descriptor_model:
        descriptor = replace(descriptor, vector=source.global_descriptors[index])
    return frame, descriptor
