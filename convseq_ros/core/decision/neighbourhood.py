# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What is near a place of the map, and where other sessions saw the same place.

A place far from the best one is its rival, unless it is the best one itself, seen on another
drive: such a look speaks for the best place, not against it. Poses in one frame tell, where both
sessions have them; else the geometry of the two references.
"""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
import math

from convseq_ros.core.constants import constants
from convseq_ros.core.geometry.verification import Verification
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.sessions import SessionBounds
from convseq_ros.core.rigid import Matrix, matrix
from convseq_ros.core.sequence.diagonals import Values
from convseq_ros.core.types import Indices, Pose
import numpy as np
import numpy.typing as npt

Compare = Callable[[int, Sequence[int]], Mapping[int, Verification]]  # a reference and others
Mask = npt.NDArray[np.bool_]


@constants
class LOOKS:
    """Of other looks of a place; chosen on drawn sessions of other light (docs/MATCHING.md)."""

    reach: int = 5  # places along the way for which what was found out holds
    shift: int = 2  # places by which two drives may part on that way
    asked: int = 2  # pairs of references that are compared for a frame; some 5 ms each
    memory: int = 64  # pairs that are remembered
    kept: int = 1000  # places of which is remembered what these tell
    controls: int = 4  # places elsewhere in the other session that geometry compares, too
    least_lead: float = 6.0  # over the best of these, in square roots of its strength
    least_m: float = 2.0  # apart, by poses of one frame, two looks may be one place in any case


class Neighbourhood:
    """
    Knows which places are near one, by their session, and which are other looks of it.

    Without a `reference_map` the map is one session, and has no other looks; `compare` tells the
    geometry of one reference and others, if it is asked.
    """

    def __init__(
        self, reference_map: ReferenceMap | None = None, compare: Compare | None = None
    ) -> None:
        self._map, self._compare = reference_map, compare
        self.bounds = reference_map.bounds if reference_map else SessionBounds()
        self.reset()

    def reset(self) -> None:
        """Forget which places are looks of each other."""
        # Pairs of references of two sessions, and whether they show one place; newest last.
        self._pairs: deque[tuple[int, int, bool]] = deque(maxlen=LOOKS.memory)
        self._looks: dict[int, list[int]] = {}  # as far as these pairs tell

    def near(self, ends: Indices, index: int, distance: int) -> Mask:
        """Return which places are near one of the same session, or near another look of it."""
        found = self.bounds.near(ends, index, distance)
        for look in self.looks(index):
            found |= self.bounds.near(ends, look, distance)
        return found

    def is_near(self, index: int, other: int, distance: int) -> bool:
        """Return whether one place is near another, or near another look of it."""
        ways = (self.bounds.around(one, distance) for one in (index, *self.looks(index)))
        return any(other in way for way in ways)

    def looks(self, index: int) -> list[int]:
        """Return places of other sessions that are known to show the same, one of a session."""
        if not self._pairs or index in self._looks:
            return self._looks.get(index, [])
        found: dict[int, int] = {}
        for one, other, is_same in reversed(self._pairs):
            for own, look in ((one, other), (other, one)) if is_same else ():
                first, end = self.bounds.span(look)
                if index in self.bounds.around(own, LOOKS.reach):
                    found.setdefault(first, min(max(look + index - own, first), end - 1))
        if len(self._looks) >= LOOKS.kept:
            self._looks.clear()
        self._looks[index] = list(found.values())
        return self._looks[index]

    def are_in_one_frame(self, one: int, other: int) -> bool:
        """Return whether the poses of two places are in one frame: of a drive, or by name."""
        if self.bounds.span(one) == self.bounds.span(other) or self._map is None:
            return True
        places, sessions = self._map.places, self._map.sessions
        frames = [sessions[places[index].session].frame for index in (one, other)]
        return bool(frames[0]) and frames[0] == frames[1]

    def follow(self, best: int, ends: Indices, scores: Values, distance: int, peak: int) -> None:
        """
        Find out which of the best rivals of a place, by scores (n,), are looks of it.

        Rivals lie further than a distance from it, and further than a peak from a look.
        """
        if len(self.bounds.starts) == 1:
            return
        asked = 0
        while asked < LOOKS.asked:
            near = self.bounds.near(ends, best, distance) | self.near(ends, best, peak)
            rivals = np.where(near, np.nan, scores)
            if not np.isfinite(rivals).any():
                return
            rival = int(ends[np.nanargmax(rivals)])
            if self.bounds.span(rival) == self.bounds.span(best) or self._is_known(best, rival):
                return
            is_same, asked = self._is_same(best, rival, distance), asked + 1
            self._pairs.append((best, rival, is_same))
            self._looks.clear()
            if not is_same:
                return

    def _is_known(self, best: int, rival: int) -> bool:
        """Return whether two places were found to differ a little way before."""
        return any(
            not is_same
            and best in self.bounds.around(one, LOOKS.reach)
            and rival + one - best in self.bounds.around(other, LOOKS.shift)
            for one, other, is_same in self._pairs
        )

    def _is_same(self, best: int, rival: int, distance: int) -> bool:
        """Return whether two references of different sessions show one place."""
        by_poses = self._is_same_by_poses(best, rival, distance)
        if by_poses is not None or self._compare is None:
            return bool(by_poses)
        first, end = self.bounds.span(rival)
        end = min(end, len(self._map or ()))
        spread = np.linspace(first, end - 1, 2 * LOOKS.controls + 1).astype(int).tolist()
        elsewhere = [one for one in spread if abs(one - rival) > distance][: LOOKS.controls]
        found = self._compare(best, [rival, *elsewhere])
        if rival not in found or not elsewhere:
            return False
        usual = max(found[one].strength for one in elsewhere)
        return found[rival].strength - usual > LOOKS.least_lead * math.sqrt(max(usual, 1.0))

    def _is_same_by_poses(self, best: int, rival: int, distance: int) -> bool | None:
        """Return the same by poses of one frame; None if they do not tell."""
        places = self._map.places if self._map else ()
        here, there = (places[index].pose for index in (best, rival)) if places else (None, None)
        if not (here and there and self.are_in_one_frame(best, rival)):
            return None
        around = [at for at in self.bounds.around(best, distance) if at < len(places)]
        ends = [pose for at in (around[0], around[-1]) if (pose := places[at].pose)]
        ways_m = (math.dist(end.position, here.position) for end in ends)
        is_alike = float(self._ahead(best, here) @ self._ahead(rival, there)) > 0
        return is_alike and math.dist(here.position, there.position) <= max(LOOKS.least_m, *ways_m)

    def _ahead(self, index: int, pose: Pose) -> Matrix:
        """Return which way the lens looked, (3,), that took a place from a pose of its base."""
        session = self._map.sessions[self._map.places[index].session] if self._map else None
        mount = session.camera.mount if session and session.camera else None
        return (matrix(pose) @ matrix(mount) if mount else matrix(pose))[:3, 0]
