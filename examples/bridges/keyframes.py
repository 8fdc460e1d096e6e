# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Shared by the bridges: a back end's keyframes by time, pending closures, and their poses."""

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
    """Keyframes of a back end; a stamp finds a keyframe at most `within_s` away."""

    def __init__(self, within_s: float = 0.15) -> None:
        self._within_ns = round(within_s * 1e9)
        self._keyframes: list[tuple[int, int]] = []
        self._ids: set[int] = set()

    def add(self, at_ns: int, ident: int) -> None:
        """Add a keyframe; a known id is ignored."""
        if ident not in self._ids:
            self._ids.add(ident)
            insort(self._keyframes, (at_ns, ident))

    def find(self, at_ns: int) -> int | None:
        """Return the id of the nearest keyframe; None without a keyframe near by."""
        index = bisect_left(self._keyframes, (at_ns, -1))
        near = self._keyframes[max(0, index - 1) : index + 1]
        best = min(near, key=lambda keyframe: abs(keyframe[0] - at_ns), default=None)
        return best[1] if best and abs(best[0] - at_ns) <= self._within_ns else None


@dataclass(frozen=True, eq=False)
class Closure:
    """A closure: the query's base in the reference's base; not finite if not measured."""

    query_ns: int
    reference_ns: int
    position: np.ndarray  # (3,), metres
    orientation: np.ndarray  # (4,), x, y, z, w
    covariance: np.ndarray  # (6, 6), of x, y, z and rotations about these axes
    confidence: float  # 1 if not given, because the closure is accepted
    session: bytes = b''  # session id of the reference

    @property
    def is_measured(self) -> bool:
        """Whether its pose in metres was measured."""
        return bool(np.isfinite([*self.position, *self.orientation]).all())

    @property
    def inverse(self) -> 'Closure':
        """The reference's base in the query's base; the stamps stay."""
        rotation = matrix(Pose((0.0, 0.0, 0.0), tuple(self.orientation.tolist())))[:3, :3].T
        change = np.zeros((6, 6))
        change[:3, :3] = change[3:, 3:] = -rotation
        change[:3, 3:] = -rotation @ cross(self.position)
        return replace(
            self,
            position=-rotation @ self.position,
            orientation=self.orientation * (-1, -1, -1, 1),
            covariance=change @ self.covariance @ change.T,
        )

    @property
    def information(self) -> np.ndarray:
        """The inverse of the covariance, (6, 6)."""
        return np.linalg.inv(self.covariance)


def closure_from(message: Any) -> Closure:
    """Return the closure in a message of `~/closure`."""
    fields = read_closure(message)
    confidence = float(fields['confidence'])
    return Closure(
        stamp_ns(fields, 'query'),
        stamp_ns(fields, 'reference'),
        np.array([float(fields[name]) for name in ('x', 'y', 'z')]),
        np.array([float(fields[name]) for name in ('qx', 'qy', 'qz', 'qw')]),
        np.array(fields['covariance'], float).reshape(6, 6),
        1.0 if math.isnan(confidence) else confidence,
        fields['reference_session'].tobytes(),
    )


def robots_of(sessions: Iterable[str]) -> dict[bytes, int]:
    """
    Return the robot that drove each session, by session id.

    A session looks like '6c0d2e4a-8f4b-4d51-9f0e-2d1f3a7b9c55=1'; `convseq info MAP` lists the
    ids. ValueError for a text of another form.
    """
    robots = {}
    for text in sessions:
        ident, _, robot = text.partition('=')
        if not robot.isdecimal():
            raise ValueError(f'sessions: {text!r} is not ID=ROBOT, such as 6c0d...9c55=1')
        try:
            robots[UUID(ident).bytes] = int(robot)
        except ValueError:
            raise ValueError(
                f'sessions: {ident!r} is no id of a session; `convseq info MAP` lists them'
            ) from None
    return robots


class Waiting:
    """
    Closures whose keyframes the back end has not published yet; the latest 1000 are kept.

    A back end may start after the closures, publish its keyframes late, or stop. `references` are
    the keyframes of the robot that drove the references, if that is another robot.
    """

    def __init__(self, keyframes: Keyframes, references: Keyframes | None = None) -> None:
        self.keyframes, self.references = keyframes, references or keyframes
        self._closures: deque[tuple[int, int, Any]] = deque(maxlen=_MOST_WAITING)

    def __len__(self) -> int:
        return len(self._closures)

    def add(self, query_ns: int, reference_ns: int, closure: Any) -> None:
        """Add a closure."""
        self._closures.append((query_ns, reference_ns, closure))

    def send(self, send: Callable[[int, int, Any], bool]) -> None:
        """
        Send every closure whose keyframes are known, as query id, reference id and closure.

        `send` returns False if the back end is not available; then the closure keeps waiting.
        """
        left = []
        for waiting in self._closures:
            query, reference = self.keyframes.find(waiting[0]), self.references.find(waiting[1])
            if query is None or reference is None:
                left.append(waiting)
                continue
            is_same = query == reference and self.references is self.keyframes
            if not is_same and not send(query, reference, waiting[2]):
                left.append(waiting)
        self._closures = deque(left, _MOST_WAITING)


def stamp_to_ns(stamp: Any) -> int:
    """Return a stamp in nanoseconds."""
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)
