# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Links between looks of one place: which earlier place shows what a place shows."""

from bisect import bisect_right
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import takewhile
import sys
from threading import Lock

from convseq_ros.core.rigid import composed_covariance, matrix, pose_of
from convseq_ros.core.types import constants, Flags, Indices, RelativePose
import numpy as np


@constants
class LINKS:
    """Of looks of one place (belief.md, section 5)."""

    reach: int = 8  # places between two anchors whose looks show one place; 2 leave gaps
    beside: int = 8  # places of a drive within which they follow one another, and are no looks


@dataclass(frozen=True, eq=False, slots=True)
class Link:
    """A place, and an earlier one of the map that it was recognised as."""

    place: int
    other: int
    anchor: int  # the first look of both
    confidence: float | None = None  # probability in [0, 1] that they show the same, if known
    inliers: int | None = None  # regions that moved alike, if verified
    relative: RelativePose | None = None  # of the base at the place, against the other's


Row = tuple[int, Link | None]  # a place, and its link; None if no earlier place shows the same


class SessionBounds:
    """
    The bounds of a map's sessions, which lie one after another; at first one that begins at 0.

    Places of different sessions are not near each other, whatever their numbers. One thread may
    begin sessions while others ask.
    """

    def __init__(self, starts: tuple[int, ...] = ()) -> None:
        self._starts, self.starts = [0], np.zeros(1, np.int64)  # (S,), ascending
        for start in starts:
            self.begin(start)

    def begin(self, start: int) -> None:
        """Have a session begin at a place that comes after all sessions so far."""
        if start > self._starts[-1]:
            self._starts.append(start)
            self.starts = np.array(self._starts, np.int64)

    def span(self, index: int) -> tuple[int, int]:
        """Return the first place of a place's session, and the next one's; the last has no end."""
        after = bisect_right(self._starts, index)
        end = self._starts[after] if after < len(self._starts) else sys.maxsize
        return self._starts[after - 1], end

    def spans(self, indices: Indices) -> tuple[Indices, Indices] | tuple[int, int]:
        """Return the same of places (n,)."""
        if len(self._starts) == 1:
            return 0, sys.maxsize
        after = np.searchsorted(self.starts, indices, 'right')
        return self.starts[after - 1], np.append(self.starts, sys.maxsize)[after]

    def around(self, index: int, distance: int) -> range:
        """Return the places of the same session within a distance, and perhaps beyond the map."""
        first, end = self.span(index)
        return range(max(first, index - distance), min(end, index + distance + 1))

    def near(self, indices: Indices, index: int, distance: int) -> Flags:
        """Return which of some places (n,) are of the same session, within a distance."""
        there = self.around(index, distance)
        return (indices >= there.start) & (indices < there.stop)

    def nearness(self, indices: Indices, others: Indices, distance: int) -> Flags:
        """Return the same of some places (n,) for each of others (m,), as (m, n)."""
        apart = abs(indices - others[:, None])
        first, end = (np.broadcast_to(one, others.shape)[:, None] for one in self.spans(others))
        return (apart <= distance) & (indices >= first) & (indices < end)


class Links:
    """
    Of the places of a map by their indices; some threads may add while others read.

    A place that shows what an earlier one shows takes over that one's anchor, the first look. Of
    other places it may be known that nothing earlier shows the same. `around` returns the places
    of a place's session within a distance.
    """

    def __init__(self, around: Callable[[int, int], range]) -> None:
        self._around, self._adding = around, Lock()
        self._anchors = dict[int, int]()  # of the places that were looked up
        self._followers = dict[int, list[int]]()  # by their anchor
        self._links = dict[int, Link]()  # as they were added, with the anchors of that time
        self._noted: list[int] = []  # places, as they came

    def __len__(self) -> int:
        return len(self._links)

    def __iter__(self) -> Iterator[tuple[int, int]]:
        """Yield linked places, in their order, and the anchor of each."""
        return ((place, self.anchor(place)) for place in sorted([*self._links]))

    def each(self) -> Iterator[Link]:
        """Yield the links, by their places."""
        return (replace(self._links[place], anchor=anchor) for place, anchor in self)

    def details(self, place: int) -> Link | None:
        """Return the link of a place, if it has one."""
        link = self._links.get(place)
        return link and replace(link, anchor=self.anchor(place))

    def anchor(self, index: int) -> int:
        """Return the first look of a place: itself, if it is not linked."""
        return self._anchors.get(index, index)

    def looks(self, index: int) -> tuple[int, ...]:
        """Return the other places that show what a place shows, but for those beside it."""
        if not self._links:
            return ()
        found, beside = list[int](), self._around(index, LINKS.beside)
        for near in self._around(self.anchor(index), LINKS.reach):
            if near in self._followers:
                found += (near, *self._followers[near])
            elif self.anchor(near) == near:
                found.append(near)
        return tuple(sorted(one for one in found if one not in beside))

    def followers(self, anchor: int) -> tuple[int, ...]:
        """Return the places whose anchor a place is, but for itself."""
        return (*self._followers.get(anchor, ()),)

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
        Note that a place shows what an earlier one shows; a link that is there stays.

        An `anchor` is known beforehand where links come without those of the other place.
        """
        if not 0 <= other < place:
            raise ValueError(f'place {place} cannot be a look of place {other}, not before it')
        with self._adding:
            if place in self._links:
                return
            anchor = self.anchor(other if anchor is None else anchor)
            moved = [place, *self._followers.get(place, ())]
            self._followers.setdefault(anchor, []).extend(moved)
            self._links[place] = Link(place, other, anchor, confidence, inliers, relative)
            for one in moved:
                self._anchors[one] = anchor
            self._followers.pop(place, None)
            self._noted.append(place)

    def add_first(self, place: int) -> None:
        """Note that nothing earlier shows what a place shows, unless it is known better."""
        with self._adding:
            if place not in self._anchors:
                self._anchors[place] = place
                self._noted.append(place)

    def knows(self, place: int) -> bool:
        """Return whether it was looked up if an earlier place shows the same."""
        return place in self._anchors

    @property
    def known(self) -> int:
        """Places that were looked up."""
        return len(self._anchors)

    def since(self, row: int, end: int) -> list[Row]:
        """Return what was noted from a row on, up to the first of a place from `end` on."""
        noted = takewhile(lambda place: place < end, self._noted[row:])
        return [(place, self.details(place)) for place in noted]


def beyond(link: Link, onward: Link) -> Link:
    """Return the link of a place to what the other one is linked to, past the other one."""
    known = [one.confidence for one in (link, onward) if one.confidence is not None]
    inliers = [one.inliers for one in (link, onward) if one.inliers is not None]
    relative = None
    if link.relative and onward.relative:
        relative = _composed(link.relative, onward.relative)
    return replace(
        link,
        other=onward.other,
        confidence=min(known, default=None),
        inliers=min(inliers, default=None),
        relative=relative,
    )


def _composed(one: RelativePose, onward: RelativePose) -> RelativePose | None:
    """Return a pose against the reference of that against which it is; None without a scale."""
    if not (one.pose and onward.pose):
        return None
    near, far = matrix(one.pose), matrix(onward.pose)
    covariance = composed_covariance(far, onward.covariance, near, one.covariance)
    pose, length_m = pose_of(far @ near), float(np.linalg.norm((far @ near)[:3, 3]))
    x, y, z = pose.position
    direction = (x / length_m, y / length_m, z / length_m) if length_m else None
    inliers = min(one.inliers, onward.inliers)
    sound = one.explains and onward.explains
    return RelativePose(pose.orientation, pose.position, direction, covariance, inliers, sound)
