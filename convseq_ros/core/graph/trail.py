# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The trail of a map's drives: what a pose graph needs to be made again after a kill."""

from collections.abc import Callable
from dataclasses import dataclass

from convseq_ros.core.types import Anchor, Pose, RelativePose


@dataclass(frozen=True, eq=False, slots=True)
class Keyframe:
    """A keyframe of a drive, whether it became a place or not: where odometry had the robot."""

    session_id: str
    stamp_ns: int
    pose: Pose  # by odometry, with variances
    other: Anchor | None = None  # the place of its closure; None without one
    # Of the robot's base, against that place, if measured; without a place, it is that of a link
    # that was not published (`closure_interval_s`).
    relative: RelativePose | None = None

    @property
    def is_held_back(self) -> bool:
        """Whether it recognised a place, and nobody was told."""
        return self.relative is not None and self.other is None


class Trail:
    """
    The keyframes of a map's drives in order; those in its file are read when they are asked for.

    `read` returns the `stored` ones. One thread may add while another takes what is new.
    """

    def __init__(self, read: Callable[[], list[Keyframe]] = list, stored: int = 0) -> None:
        self._read, self._stored = read, stored
        self._in_memory: list[Keyframe] = []

    def __len__(self) -> int:
        return self._stored + len(self._in_memory)

    def add(self, keyframe: Keyframe) -> None:
        """Append a keyframe."""
        self._in_memory.append(keyframe)

    def since(self, number: int) -> list[Keyframe]:
        """Return the keyframes from a number on."""
        if number >= self._stored:
            return self._in_memory[number - self._stored :]
        return [*self._read(), *self._in_memory][number:]

    def evict(self, count: int) -> None:
        """Release the first `count` keyframes, which `read` can read now."""
        del self._in_memory[: max(0, count - self._stored)]
        self._stored = max(count, self._stored)
