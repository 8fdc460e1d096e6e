# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Links between places of a map that show the same scene: looks of one place."""

from array import array
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import takewhile
import math
from struct import Struct
from threading import Lock

from convseq_ros.core.graph.packed_pose import packed_pose, unpacked_pose
from convseq_ros.core.rigid import composed_covariance, matrix, pose_of
from convseq_ros.core.types import constants, RelativePose
import numpy as np


@constants
class LINKS:
    """Constants of the looks of a place."""

    reach: int = 8  # places between two anchors that still count as one place; 2 leave gaps
    neighbour_radius: int = 8  # within which places of a drive are neighbours, not looks


@dataclass(frozen=True, eq=False, slots=True)
class Link:
    """A place, and the earlier place of the map that it was recognised as."""

    place: int
    other: int
    anchor: int  # the first look of both
    confidence: float | None = None  # probability in [0, 1] that they show the same scene
    inliers: int | None = None  # regions that moved consistently, if verified
    relative: RelativePose | None = None  # of the robot's base at the place, against the other's


# What is kept of a link before its packed relative pose: the other place, the confidence, NaN if
# there is none, and the inliers, -1 if there are none.
_FACTS = Struct('<qdq')
# A place, its link (None if it was looked up without a result), and whether a person took it out.
Row = tuple[int, Link | None, bool]


class Links:
    """
    The links of a map's places, by index; threads may add links while others read.

    A place with a link shares the anchor of the earlier place: the first look of both. A place
    without a link may be marked as looked up: no earlier place shows the same scene. A place that
    a person unlinked is never linked again. `around` returns the places of a place's session
    within a distance, as `SessionBounds.around` does.
    """

    def __init__(self, around: Callable[[int, int], range]) -> None:
        self._around, self._adding = around, Lock()
        # By place: its anchor, the next place with the same anchor (0: none), and the number of
        # its record (-1: none). In numbers of 4 bytes, since these are held for every place.
        self._anchors, self._next, self._number = array('i'), array('i'), array('i')
        # Records: the places that were looked up, in order, and what is kept of their links.
        self._recorded, self._kept = array('i'), list[bytes]()
        self._linked = self._looked_up = 0  # how many places
        self._unlinked = set[int]()  # by a person

    def __len__(self) -> int:
        return self._linked

    def __iter__(self) -> Iterator[tuple[int, int]]:
        """Yield linked places with their anchors, by ascending place."""
        return ((link.place, link.anchor) for link in self.each())

    def each(self) -> Iterator[Link]:
        """Yield the links by ascending place."""
        return filter(None, map(self.details, range(len(self._number))))

    def details(self, place: int) -> Link | None:
        """Return the link of a place with its anchor of now; None without a link."""
        if not (kept := self._kept_of(place)):
            return None
        other, confidence, inliers = _FACTS.unpack_from(kept)
        return Link(
            place,
            other,
            self.anchor(place),
            None if math.isnan(confidence) else confidence,
            None if inliers < 0 else inliers,
            unpacked_pose(kept[_FACTS.size :]) if len(kept) > _FACTS.size else None,
        )

    def _kept_of(self, place: int) -> bytes:
        """Return what is kept of the link of a place; nothing without a link."""
        return self._kept[self._number[place]] if self.is_looked_up(place) else b''

    def anchor(self, index: int) -> int:
        """Return the first look of a place: the place itself if it is not linked."""
        return self._anchors[index] if 0 <= index < len(self._anchors) else index

    def looks(self, index: int) -> tuple[int, ...]:
        """Return the other places that show the same as a place, without its neighbours."""
        if not self._linked:
            return ()
        looks = self._looks_of(self._around(self.anchor(index), LINKS.reach))
        neighbours = self._around(index, LINKS.neighbour_radius)
        return tuple(sorted(look for look in looks if look not in neighbours))

    def _looks_of(self, places: range) -> list[int]:
        """Return the anchors among places, each before the others that have it."""
        looks = list[int]()
        for place, anchor in enumerate(self._anchors[places.start : places.stop], places.start):
            if place == anchor:
                looks.append(place)
                while follower := self._next[looks[-1]]:
                    looks.append(follower)
        return looks

    def followers(self, anchor: int) -> tuple[int, ...]:
        """Return the other places whose anchor is a place."""
        return (*self._looks_of(range(anchor, anchor + 1))[1:],)

    def add(
        self,
        place: int,
        other: int,
        confidence: float | None = None,
        inliers: int | None = None,
        relative: RelativePose | None = None,
        anchor: int | None = None,
    ) -> None:
        """
        Link a place to an earlier one that shows the same scene; a place keeps its first link.

        A place that a person unlinked gets none. An `anchor` is given if the links of the other
        place are not added before.
        """
        if not 0 <= other < place:
            raise ValueError(f'place {place} cannot be a look of place {other}, not before it')
        with self._adding:
            if self._kept_of(place) or place in self._unlinked:
                return
            facts = (
                other,
                math.nan if confidence is None else confidence,
                -1 if inliers is None else inliers,
            )
            packed = b'' if relative is None else packed_pose(relative)
            anchor = self.anchor(other if anchor is None else anchor)
            self._record(place, anchor, _FACTS.pack(*facts) + packed)
            self._linked += 1

    def add_first(self, place: int) -> None:
        """Mark a place as looked up without a result, unless it is looked up already."""
        with self._adding:
            if not self.is_looked_up(place):
                self._record(place, place)

    def _record(self, place: int, anchor: int, kept: bytes = b'') -> None:
        """Record what a place shows; others may read meanwhile."""
        self._looked_up += not self.is_looked_up(place)
        new = range(len(self._anchors), place + 1)
        self._next.extend([0] * len(new))
        self._number.extend([-1] * len(new))
        self._anchors.extend(new)
        if anchor != place:
            moved = [place, *self.followers(place)]
            self._next[moved[-1]] = self._next[anchor]
            for follower in moved:
                self._anchors[follower] = anchor
            self._next[anchor] = place
        self._kept.append(kept)
        self._number[place] = len(self._kept) - 1
        self._recorded.append(place)

    def add_unlinked(self, place: int) -> None:
        """Mark a place without a link as looked up, and as unlinked by a person."""
        self._unlinked.add(place)
        self.add_first(place)

    def is_unlinked(self, place: int) -> bool:
        """Return whether a person unlinked a place."""
        return place in self._unlinked

    def is_looked_up(self, place: int) -> bool:
        """Return whether a place was looked up among the earlier places."""
        return 0 <= place < len(self._anchors) and self._number[place] >= 0

    @property
    def looked_up_count(self) -> int:
        """Number of places that were looked up."""
        return self._looked_up

    def since(self, row: int, end: int) -> list[Row]:
        """Return the records from a row on, up to the first whose place is not before `end`."""
        recorded = takewhile(lambda place: place < end, self._recorded[row:])
        return [(at, self.details(at), at in self._unlinked) for at in recorded]


def chained(link: Link, onward: Link) -> Link:
    """Return a link that skips a place: from a link to that place and its link onward."""
    confidences = [one.confidence for one in (link, onward) if one.confidence is not None]
    inliers = [one.inliers for one in (link, onward) if one.inliers is not None]
    relative = None
    if link.relative and onward.relative:
        relative = _composed(link.relative, onward.relative)
    return replace(
        link,
        other=onward.other,
        confidence=min(confidences, default=None),
        inliers=min(inliers, default=None),
        relative=relative,
    )


def _composed(first: RelativePose, onward: RelativePose) -> RelativePose | None:
    """Return the composition of two relative poses in a row; None if one has no scale."""
    if not (first.pose and onward.pose):
        return None
    near, far = matrix(first.pose), matrix(onward.pose)
    covariance = composed_covariance(far, onward.covariance, near, first.covariance)
    pose, length_m = pose_of(far @ near), float(np.linalg.norm((far @ near)[:3, 3]))
    x, y, z = pose.position
    direction = (x / length_m, y / length_m, z / length_m) if length_m else None
    inliers = min(first.inliers, onward.inliers)
    explains = first.explains and onward.explains
    return RelativePose(pose.orientation, pose.position, direction, covariance, inliers, explains)
