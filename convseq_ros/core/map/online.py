# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Online mapping: a map grows from the robot's own past, and keeps so many looks of a place."""

from itertools import chain, pairwise
import math

from convseq_ros.config import Config
from convseq_ros.core.encoding.first_stage import vector_of
from convseq_ros.core.graph.links import LINKS, Links
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import constants, Descriptor, Frame, Halves, Match, Pose, Reason
import numpy as np

_RECOGNISED = frozenset({Reason.ACCEPTED, Reason.COOL_DOWN})


def known_as(match: Match | None) -> int | None:
    """Return the place that a match recognises, if it does."""
    if match is None or match.reason not in _RECOGNISED or match.best is None:
        return None
    return match.best.reference_index


def link(links: Links, place: int, match: Match | None) -> None:
    """Link a place as it was recognised, if it was looked up."""
    known = known_as(match)
    if match and match.best and known is not None:
        links.add(place, known, match.confidence, match.best.inliers, match.relative_pose)
    elif match:
        links.add_first(place)


@constants
class LOOK:
    """By recall on a drawn round that is driven 34 times (scripts/links.py --part round)."""

    # Keyframes of a drive that stay or go together: without those beside them, the frames of a
    # sequence meet other places, and recall falls to .75.
    stretch: int = 16
    # A new look stays if it is so many times as far from all others as two of these are from each
    # other. Noise alone, anew in each round, makes up to 1.8.
    further: float = 2.0


class Looks:
    """
    Tells which looks of a place a map does without that keeps `max_looks` of each; 0 is no limit.

    A look is a stretch of one drive. Of more looks of a place the one that is most like another
    goes, by the global descriptors of what shows the place; of the two, the later one. The newest
    goes unless it is much less like them than they are like each other. Anchors stay. What was not
    recognised counts as if it had been, by what was beside it.
    """

    def __init__(self, reference_map: ReferenceMap, max_looks: int) -> None:
        self._map, self._most = reference_map, max_looks
        self._of = dict[int, list[int]]()  # stretches that are kept, by the first one of a place
        self.surplus = list[int]()  # places that the map does without, ascending
        if not max_looks or not len(reference_map.links):
            return
        for start, end in pairwise([*reference_map.bounds.starts.tolist(), len(reference_map)]):
            for stretch in range(start, end, LOOK.stretch):
                first = {place: self._first(place) for place in self._places(stretch)}
                looks = [place for place in first if first[place] < stretch]
                if 2 * len(looks) > len(first):  # else it shows more that is new
                    shown = reference_map.global_descriptors[looks[0]]
                    gone = self._take(stretch, first[looks[0]], shown)
                    self.surplus += self._places(gone) if gone is not None else ()
        self.surplus.sort()

    def has_room(self, known: int, descriptor: Halves) -> bool:
        """Return whether a stretch is kept that begins now at a place, with a descriptor (m,)."""
        new = len(self._map)
        return self._take(new, self._first(known), descriptor) != new

    def _take(self, stretch: int, first: int, descriptor: Halves) -> int | None:
        """Keep a further stretch of a place, with its first look; return which one goes for it."""
        own = self._of.setdefault(self._stretch(first), [self._stretch(first)])
        own.append(stretch)
        if not 0 < self._most < len(own):
            return None
        shown = [
            min(self._places(one), key=lambda place: abs(self._first(place) - first))
            for one in own[:-1]
        ]
        rows = np.vstack([self._map.global_descriptors[shown], descriptor]).astype(np.float32)
        rows /= np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), np.finfo(np.float32).tiny)
        followers = self._map.links.followers
        stay = np.array([any(map(followers, self._places(one))) for one in own])
        stay[0] = True
        apart = np.maximum(1 - rows @ rows.T, np.finfo(np.float32).eps)
        apart[-1] /= LOOK.further  # so that of images that are the same, the newest goes
        apart[np.triu_indices(len(rows))] = np.inf
        apart[np.ix_(stay, stay)] = np.inf
        later, sooner = divmod(int(apart.argmin()), len(rows))
        if not np.isfinite(apart[later, sooner]):
            return None
        return own.pop(sooner if stay[later] else later)

    def _stretch(self, place: int) -> int:
        start, _ = self._map.bounds.span(place)
        return start + (place - start) // LOOK.stretch * LOOK.stretch

    def _places(self, stretch: int) -> range:
        _, end = self._map.bounds.span(stretch)
        return range(stretch, min(stretch + LOOK.stretch, end, len(self._map)))

    def _first(self, place: int) -> int:
        """Return the first look of a place, or where it would be if it had been recognised."""
        links, bounds = self._map.links, self._map.bounds
        place = links.anchor(place)
        start, end = bounds.span(place)
        near = range(1, LINKS.beside // 2 + 1)
        for off in chain.from_iterable((one, -one) for one in near):
            if start <= place + off < end and (there := links.anchor(place + off)) != place + off:
                passed = max(bounds.span(there)[0], there - off)
                return self._first(passed) if passed < place else place
        return place


class PreloadedMap:
    """A map that does not grow: all of its places may be matched."""

    nothing_usable = Reason.NO_MAP  # reported for a frame as long as no place may be matched

    def __init__(self, reference_map: ReferenceMap) -> None:
        self._map = reference_map
        self.reset()

    def reset(self) -> None:
        """Begin a new session: all that is in the map is the past."""
        self.session_start = len(self._map)  # the first place of this session

    def update(self, _stamp_ns: int, _pose: Pose | None) -> int:
        """Return how many places, from the first, may be matched."""
        return len(self._map)

    def add(self, frame: Frame, descriptor: Descriptor, _match: Match | None = None) -> None:
        """Add nothing."""


class OnlineMap(PreloadedMap):
    """Adds the frames of this session, and excludes those that are recent from being matched."""

    nothing_usable = Reason.RECENT

    def __init__(
        self, reference_map: ReferenceMap, config: Config, name: str = '', frame: str = ''
    ) -> None:
        self._name, self._frame = name, frame or None  # of this session, and of its poses
        self._exclusion_ns = round(config.online.exclusion_s * 1e9)
        self._exclusion_m = config.online.exclusion_m
        self._looks = Looks(reference_map, config.online.max_looks)
        kept = config.keyframes
        self._widths_px = kept.thumbnail_width_px, kept.keep_images_px
        super().__init__(reference_map)

    def reset(self) -> None:
        super().reset()
        self._usable, self._travelled_m = self.session_start, 0.0
        self._pose: Pose | None = None
        self._passed_m: list[float] = []
        self._left_out = 0  # frames that are not added any more

    def update(self, stamp_ns: int, pose: Pose | None) -> int:
        """Sum up the way by odometry; return how many places are old enough to be matched."""
        if pose and self._pose:
            self._travelled_m += math.dist(pose.position, self._pose.position)
        self._pose = pose or self._pose
        passed = self.session_start + len(self._passed_m)
        while self._usable < passed and self._is_past(self._usable, stamp_ns):
            self._usable += 1
        return self._usable

    def add(self, frame: Frame, descriptor: Descriptor, _match: Match | None = None) -> None:
        """
        Add a frame to the map, and link it as it was recognised, unless it could not be read.

        Where its place has all looks, and it is most like one of them, nothing is added for a
        stretch, as long as it is recognised; else one of them goes when the map is closed.
        """
        if frame.gray is None or self._passes_over(known_as(_match), descriptor):
            return
        if len(self._map) == self.session_start:
            self._map.begin_session(frame.stamp_ns, frame.camera, self._name, self._frame)
        self._map.add_frame(frame, descriptor, *self._widths_px)
        self._passed_m.append(self._travelled_m)
        link(self._map.links, len(self._map) - 1, _match)

    def _passes_over(self, known: int | None, descriptor: Descriptor) -> bool:
        self._left_out -= 1
        if known is None:
            self._left_out = 0
        elif self._left_out <= 0 and not len(self._passed_m) % LOOK.stretch:
            shown = vector_of(descriptor)
            self._left_out = 0 if self._looks.has_room(known, shown) else LOOK.stretch
        return self._left_out > 0

    def _is_past(self, index: int, stamp_ns: int) -> bool:
        way_m = self._travelled_m - self._passed_m[index - self.session_start]
        is_far = self._pose is None or way_m >= self._exclusion_m
        return is_far and stamp_ns - self._map.places[index].stamp_ns >= self._exclusion_ns


class FollowedMap(PreloadedMap):
    """A map to which another camera of the same robot adds."""

    def __init__(self, reference_map: ReferenceMap, leader: PreloadedMap) -> None:
        self._leader, self.nothing_usable = leader, leader.nothing_usable
        super().__init__(reference_map)

    def reset(self) -> None:
        self.session_start = self._leader.session_start

    def update(self, stamp_ns: int, pose: Pose | None) -> int:
        self.session_start = self._leader.session_start
        return self._leader.update(stamp_ns, pose)
