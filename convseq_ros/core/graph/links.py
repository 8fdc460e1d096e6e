# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Links between looks of one place: which earlier place shows what a place shows."""

from collections.abc import Callable, Iterator
from threading import Lock

from convseq_ros.core.constants import constants

Row = tuple[int, int | None]  # a place and its anchor; None if no earlier place shows the same


@constants
class LINKS:
    """Of looks of one place (belief.md, section 5)."""

    reach: int = 8  # places between two anchors whose looks show one place; 2 leave gaps
    beside: int = 8  # places of a drive within which they follow one another, and are no looks


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
        self._rows: list[Row] = []  # as they came

    def __len__(self) -> int:
        return sum(len(some) for some in [*self._followers.values()])

    def __iter__(self) -> Iterator[tuple[int, int]]:
        """Yield linked places, in their order, and the anchor of each."""
        pairs = sorted([*self._anchors.items()])
        return ((place, anchor) for place, anchor in pairs if place != anchor)

    def anchor(self, index: int) -> int:
        """Return the first look of a place: itself, if it is not linked."""
        return self._anchors.get(index, index)

    def looks(self, index: int) -> tuple[int, ...]:
        """Return the other places that show what a place shows, but for those beside it."""
        found, beside = list[int](), self._around(index, LINKS.beside)
        for near in self._around(self.anchor(index), LINKS.reach):
            if self.anchor(near) == near:
                found += (near, *self._followers.get(near, ()))
        return tuple(sorted(one for one in found if one not in beside))

    def add(self, place: int, other: int) -> None:
        """Note that a place shows what an earlier one shows; a link that is there stays."""
        if not 0 <= other < place:
            raise ValueError(f'place {place} cannot be a look of place {other}, not before it')
        with self._adding:
            if self.anchor(place) != place:
                return
            anchor, moved = self.anchor(other), [place, *self._followers.get(place, ())]
            self._followers.setdefault(anchor, []).extend(moved)
            for one in moved:
                self._anchors[one] = anchor
            self._followers.pop(place, None)
            self._rows.append((place, anchor))

    def add_first(self, place: int) -> None:
        """Note that nothing earlier shows what a place shows, unless it is known better."""
        with self._adding:
            if place not in self._anchors:
                self._anchors[place] = place
                self._rows.append((place, None))

    def note(self, place: int, other: int | None) -> None:
        """Note what earlier place shows what a place shows, if one was found."""
        if other is None:
            self.add_first(place)
        else:
            self.add(place, other)

    def knows(self, place: int) -> bool:
        """Return whether it was looked up if an earlier place shows the same."""
        return place in self._anchors

    @property
    def known(self) -> int:
        """Places that were looked up."""
        return len(self._anchors)

    @property
    def rows(self) -> int:
        """What was noted so far, one row after another."""
        return len(self._rows)

    def since(self, row: int, end: int) -> list[Row]:
        """Return what was noted from a row on, up to the first of a place from `end` on."""
        stop = row
        while stop < len(self._rows) and self._rows[stop][0] < end:
            stop += 1
        return self._rows[row:stop]
