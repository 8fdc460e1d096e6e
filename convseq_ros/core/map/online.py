# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Online mapping: the map grows while the robot drives, and may limit the looks of a place."""

from bisect import bisect_left
from itertools import chain, pairwise

from convseq_ros.config import Config
from convseq_ros.core.encoding.first_stage import vector_of
from convseq_ros.core.graph.links import LINKS, Links
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import constants, Descriptor, Frame, Halves, Match, Reason
import numpy as np

_RECOGNISED = frozenset({Reason.ACCEPTED, Reason.COOL_DOWN})


def recognised_place(match: Match | None) -> int | None:
    """Return the place that a match recognises; None if it recognises none."""
    if match is None or match.reason not in _RECOGNISED or match.best is None:
        return None
    return match.best.reference_index


def link(links: Links, place: int, match: Match | None) -> None:
    """Link a place to the one that its match recognises, or mark it as looked up."""
    other = recognised_place(match)
    if match and match.best and other is not None:
        links.add(place, other, match.confidence, match.best.inliers, match.relative_pose)
    elif match:
        links.add_first(place)


@constants
class RECENT:
    """Which places of the running drive are too recent to be matched."""

    # Keyframes by the default spacing that the drive must be past a place, so laps of 5 s and of
    # 5 h are the same. Drives that never return have no match with 20; 40 is no safer.
    keyframes: int = 20


@constants
class LOOK:
    """Chosen by recall on a drawn lap that is driven 34 times (scripts/links.py --part round)."""

    # Keyframes of a drive that are kept or removed together. If single keyframes are removed, the
    # frames of a sequence match different drives, and recall falls to 75 %.
    stretch: int = 16
    # A new look is kept if its distance to every other look is at least this many times the
    # smallest distance between two others. Noise alone, new in each lap, makes up to 1.8.
    further: float = 2.0


class Looks:
    """
    Selects the looks to remove from a map that keeps `max_looks` of each place; 0 is no limit.

    A look is a stretch of keyframes of one drive. If a place has too many looks, the later one of
    the two most similar looks is removed, by their global descriptors. The newest look is removed
    unless it is twice as far from all others as their closest pair. Anchors are kept. A
    place that was not recognised belongs to the place that its recognised neighbours imply.
    """

    def __init__(self, reference_map: ReferenceMap, max_looks: int) -> None:
        self._map, self._max_looks = reference_map, max_looks
        self._kept = dict[int, list[int]]()  # stretches that are kept, by a place's first stretch
        self.surplus = list[int]()  # indices of places to remove, ascending
        if not max_looks or not len(reference_map.links):
            return
        for start, end in pairwise([*reference_map.bounds.starts.tolist(), len(reference_map)]):
            for stretch in range(start, end, LOOK.stretch):
                first = {place: self._first(place) for place in self._places(stretch)}
                looks = [place for place in first if first[place] < stretch]
                if 2 * len(looks) > len(first):  # else most of the stretch is new
                    descriptor = reference_map.global_descriptors[looks[0]]
                    removed = self._add(stretch, first[looks[0]], descriptor)
                    self.surplus += self._places(removed) if removed is not None else ()
        self.surplus.sort()

    def has_room(self, place: int, descriptor: Halves) -> bool:
        """Return whether a stretch is kept that begins now at a place, with a descriptor (m,)."""
        new = len(self._map)
        return self._add(new, self._first(place), descriptor) != new

    def _add(self, stretch: int, first: int, descriptor: Halves) -> int | None:
        """Add a stretch to a place, given by its first look; return the stretch to remove."""
        looks = self._kept.setdefault(self._stretch(first), [self._stretch(first)])
        looks.append(stretch)
        if not 0 < self._max_looks < len(looks):
            return None
        nearest = [
            min(self._places(look), key=lambda place: abs(self._first(place) - first))
            for look in looks[:-1]
        ]
        rows = np.vstack([self._map.global_descriptors[nearest], descriptor]).astype(np.float32)
        rows /= np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), np.finfo(np.float32).tiny)
        followers = self._map.links.followers
        stay = np.array([any(map(followers, self._places(look))) for look in looks])
        stay[0] = True
        distances = np.maximum(1 - rows @ rows.T, np.finfo(np.float32).eps)
        distances[-1] /= LOOK.further  # the newest look is removed first if images are the same
        distances[np.triu_indices(len(rows))] = np.inf
        distances[np.ix_(stay, stay)] = np.inf
        later, earlier = divmod(int(distances.argmin()), len(rows))
        if not np.isfinite(distances[later, earlier]):
            return None
        return looks.pop(earlier if stay[later] else later)

    def _stretch(self, place: int) -> int:
        start, _ = self._map.bounds.span(place)
        return start + (place - start) // LOOK.stretch * LOOK.stretch

    def _places(self, stretch: int) -> range:
        _, end = self._map.bounds.span(stretch)
        return range(stretch, min(stretch + LOOK.stretch, end, len(self._map)))

    def _first(self, place: int) -> int:
        """Return the first look of a place; if it is not linked, as a linked neighbour implies."""
        links, bounds, steps = self._map.links, self._map.bounds, range(1, LINKS.beside // 2 + 1)
        place = links.anchor(place)
        start, end = bounds.span(place)
        for offset in chain.from_iterable((step, -step) for step in steps):
            neighbour = place + offset
            if start <= neighbour < end and (anchor := links.anchor(neighbour)) != neighbour:
                implied = max(bounds.span(anchor)[0], anchor - offset)
                return self._first(implied) if implied < place else place
        return place


class PreloadedMap:
    """A map that does not grow: all of its places may be matched."""

    nothing_usable = Reason.NO_MAP  # the reason of a frame while no place may be matched

    def __init__(self, reference_map: ReferenceMap) -> None:
        self._map = reference_map
        self.reset()

    def reset(self) -> None:
        """Begin a new session, at the end of the map."""
        self.session_start = len(self._map)  # first place of this session

    @property
    def usable(self) -> int:
        """How many places, from the first, may be matched."""
        return len(self._map)

    def follow(self, passed: int) -> None:
        """Take in how many scenes the drive has passed (`Verdict.passed`)."""

    def add(self, frame: Frame, descriptor: Descriptor, _match: Match | None = None) -> None:
        """Add nothing."""

    def freeze(self) -> None:
        """Add nothing from now on."""


class OnlineMap(PreloadedMap):
    """A map that grows by the frames of this session; recent places may not be matched."""

    nothing_usable = Reason.RECENT

    def __init__(
        self, reference_map: ReferenceMap, config: Config, name: str = '', frame: str = ''
    ) -> None:
        self._name, self._frame = name, frame or None  # name of the session, frame of its poses
        self._looks = Looks(reference_map, config.online.max_looks)
        keyframes = config.keyframes
        self._kept = keyframes.thumbnail_width_px, keyframes.keep_images_px, keyframes.keypoints
        self._is_frozen = False
        super().__init__(reference_map)

    def reset(self) -> None:
        super().reset()
        self._usable, self._passed = self.session_start, 0
        self._passed_at: list[int] = []  # by place of this session: scenes passed, with it
        self._skipping = 0  # number of frames that are still to be left out

    @property
    def usable(self) -> int:
        """How many places, from the first, are old enough to be matched."""
        return self._usable

    def follow(self, passed: int) -> None:
        """Take in how many scenes the drive has passed (`Verdict.passed`)."""
        self._passed, oldest = passed, passed - RECENT.keyframes
        self._usable = self.session_start + bisect_left(self._passed_at, oldest)

    def add(self, frame: Frame, descriptor: Descriptor, _match: Match | None = None) -> None:
        """
        Add a readable frame to the map, and link it to the place that its match recognises.

        If the place has `max_looks` looks and the frame is similar to one of them, no frame is
        added for a stretch while places are recognised. Surplus looks go when the map is closed.
        """
        if self._is_frozen or frame.gray is None:
            return
        if self._skips(recognised_place(_match), descriptor):
            return
        if len(self._map) == self.session_start:
            self._map.begin_session(frame.stamp_ns, frame.camera, self._name, self._frame)
        self._map.add_frame(frame, descriptor, *self._kept)
        self._passed_at.append(self._passed)
        link(self._map.links, len(self._map) - 1, _match)

    def freeze(self) -> None:
        self._is_frozen = True

    def _skips(self, place: int | None, descriptor: Descriptor) -> bool:
        self._skipping -= 1
        if place is None:
            self._skipping = 0
        elif self._skipping <= 0 and not len(self._passed_at) % LOOK.stretch:
            vector = vector_of(descriptor)
            self._skipping = 0 if self._looks.has_room(place, vector) else LOOK.stretch
        return self._skipping > 0


class FollowedMap(PreloadedMap):
    """A map that grows by the frames of another camera of the same robot, the leader."""

    def __init__(self, reference_map: ReferenceMap, leader: PreloadedMap) -> None:
        self._leader, self.nothing_usable = leader, leader.nothing_usable
        super().__init__(reference_map)

    def reset(self) -> None:
        self.session_start = self._leader.session_start

    @property
    def usable(self) -> int:
        """How many places the leader may match."""
        return self._leader.usable

    def follow(self, _passed: int) -> None:
        """Follow the leader's session; it counts the scenes itself."""
        self.session_start = self._leader.session_start


def mapping_of(reference_map: ReferenceMap, config: Config) -> PreloadedMap:
    """Return how a map is used in the mode of a configuration."""
    grows = config.online.grows
    return OnlineMap(reference_map, config) if grows else PreloadedMap(reference_map)
