# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What every bridge needs: a back end's keyframes by time, closures that wait, and their poses."""

from bisect import bisect_left, insort
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
import math
from pathlib import Path
import sys
from typing import Any
from uuid import UUID

from convseq_ros.core.rigid import cross, matrix
from convseq_ros.core.types import Pose
import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[1] / 'closures'))
from read_closure import read_closure, stamp_ns

_MOST_WAITING = 1000


class Keyframes:
    """Keyframes of a back end, found by a stamp that is at most `within_s` away."""

    def __init__(self, within_s: float = 0.15) -> None:
        self._within_ns = round(within_s * 1e9)
        self._known: list[tuple[int, int]] = []
        self._ids: set[int] = set()

    def add(self, at_ns: int, ident: int) -> None:
        """Take in a keyframe; one that is known already is left out."""
        if ident not in self._ids:
            self._ids.add(ident)
            insort(self._known, (at_ns, ident))

    def find(self, at_ns: int) -> int | None:
        """Return the id of the nearest keyframe; None if none is near."""
        index = bisect_left(self._known, (at_ns, -1))
        near = self._known[max(0, index - 1) : index + 1]
        best = min(near, key=lambda one: abs(one[0] - at_ns), default=None)
        return best[1] if best and abs(best[0] - at_ns) <= self._within_ns else None


@dataclass(frozen=True, eq=False)
class Closure:
    """A closure: the pose of the query's base in the reference's, not finite if not measured."""

    query_ns: int
    reference_ns: int
    position: np.ndarray  # (3,), metres
    orientation: np.ndarray  # (4,), x, y, z, w
    covariance: np.ndarray  # (6, 6), of x, y, z and turns about them
    confidence: float  # 1 if there is none, since it is accepted
    session: bytes = b''  # the id of the reference's

    @property
    def is_measured(self) -> bool:
        """Whether its pose in metres is known."""
        return bool(np.isfinite([*self.position, *self.orientation]).all())

    @property
    def inverse(self) -> 'Closure':
        """The same, of the reference's base in the query's; the stamps stay."""
        turn = matrix(Pose((0.0, 0.0, 0.0), tuple(self.orientation.tolist())))[:3, :3].T
        change = np.zeros((6, 6))
        change[:3, :3] = change[3:, 3:] = -turn
        change[:3, 3:] = -turn @ cross(self.position)
        return replace(
            self,
            position=-turn @ self.position,
            orientation=self.orientation * (-1, -1, -1, 1),
            covariance=change @ self.covariance @ change.T,
        )

    @property
    def information(self) -> np.ndarray:
        """The inverse of the covariance, (6, 6)."""
        return np.linalg.inv(self.covariance)


def closure_from(message: Any) -> Closure:
    """Return what `~/closure` says."""
    read = read_closure(message)
    confidence = float(read['confidence'])
    return Closure(
        stamp_ns(read, 'query'),
        stamp_ns(read, 'reference'),
        np.array([float(read[name]) for name in ('x', 'y', 'z')]),
        np.array([float(read[name]) for name in ('qx', 'qy', 'qz', 'qw')]),
        np.array(read['covariance'], float).reshape(6, 6),
        1.0 if math.isnan(confidence) else confidence,
        read['reference_session'].tobytes(),
    )


def robots_of(sessions: Iterable[str]) -> dict[bytes, int]:
    """
    Return which robot drove each session, by the session's id.

    `sessions` are such as '6c0d2e4a-8f4b-4d51-9f0e-2d1f3a7b9c55=1'; `convseq info MAP` lists the
    ids. ValueError if one is no id and number.
    """
    found = {}
    for text in sessions:
        ident, _, robot = text.partition('=')
        if not robot.isdecimal():
            raise ValueError(f'sessions: {text!r} is not ID=ROBOT, such as 6c0d...9c55=1')
        try:
            found[UUID(ident).bytes] = int(robot)
        except ValueError:
            raise ValueError(
                f'sessions: {ident!r} is no id of a session; `convseq info MAP` lists them'
            ) from None
    return found


class Waiting:
    """
    Closures whose keyframes the back end has not told yet; the oldest give way after 1000.

    A back end may come later than the closures, tell its keyframes late, or go away. `references`
    are keyframes of the robot that drove where the closures lead, if that is another.
    """

    def __init__(self, keyframes: Keyframes, references: Keyframes | None = None) -> None:
        self.keyframes, self.references = keyframes, references or keyframes
        self._closures: deque[tuple[int, int, Any]] = deque(maxlen=_MOST_WAITING)

    def __len__(self) -> int:
        return len(self._closures)

    def add(self, query_ns: int, reference_ns: int, closure: Any) -> None:
        """Take in a closure."""
        self._closures.append((query_ns, reference_ns, closure))

    def send(self, send: Callable[[int, int, Any], bool]) -> None:
        """
        Send every closure whose keyframes are known, with these: query, reference.

        `send` returns False if the back end is not there; such a closure waits on.
        """
        left = []
        for one in self._closures:
            query, reference = self.keyframes.find(one[0]), self.references.find(one[1])
            if query is None or reference is None:
                left.append(one)
                continue
            is_same = query == reference and self.references is self.keyframes
            if not is_same and not send(query, reference, one[2]):
                left.append(one)
        self._closures = deque(left, _MOST_WAITING)


def stamp_to_ns(stamp: Any) -> int:
    """Return a stamp in nanoseconds."""
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)
