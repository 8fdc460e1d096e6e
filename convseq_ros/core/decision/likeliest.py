# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The likeliest places of the newest frames: what these say together, before a sequence does."""

from collections.abc import Mapping
from dataclasses import dataclass
import math

from convseq_ros.core.constants import constants
from convseq_ros.core.decision.neighbourhood import Neighbourhood
from convseq_ros.core.decision.track_evidence import TRACK


@constants
class LIKELIEST:
    """Chosen on drawn drives and on real images made dark (docs/GEOMETRY.md)."""

    same_scene: int = 1  # references by which two frames of one place may differ ...
    drift: float = 0.5  # ... and each frame between them adds so many: half to 1.5 times as fast
    recent: int = 3  # newest frames over which strengths are averaged
    frames: int = 5  # newest ones that are evidence alone
    on_line: int = 4  # of these, whose places tell a velocity (scripts/spacing.py) ...
    track: float = 1.7  # ... unless a track of so much evidence, which suffices for a match, does
    # Deviations that count alone as much as a scatter in each frame of a track.
    alone: float = 14.0


@dataclass(frozen=True, slots=True)
class Likeliest:
    """The likeliest place of one frame."""

    frame: int  # its number
    reference: int
    evidence: float  # how much it stands out; at least 0
    strength: float  # of its verification


class LikeliestPlaces:
    """Keeps the likeliest place of each of the newest five frames."""

    def __init__(self, neighbourhood: Neighbourhood) -> None:
        self._places = neighbourhood
        self._kept: list[Likeliest] = []

    def add(self, newest: Likeliest) -> None:
        """Take in that of the newest frame."""
        oldest = newest.frame - LIKELIEST.frames
        self._kept = [*(one for one in self._kept if one.frame > oldest), newest]

    def alone(self, frame: int, direction: float = 1.0) -> tuple[int, float] | None:
        """
        Return the newest frame's likeliest place, and how strongly the newest frames speak for it.

        The most that any number of them, up to five, say: the sum of those on one way, over the
        square root of how many they are; in units of the evidence of a track. The direction is -1
        of a drive that meets the places in reverse order.
        """
        on_way = self._on_way(frame, direction)
        if 0 not in on_way:
            return None
        total = most = 0.0
        for past in range(LIKELIEST.frames):
            total += on_way[past].evidence if past in on_way else 0.0
            most = max(most, total / math.sqrt(past + 1))
        return on_way[0].reference, most / LIKELIEST.alone

    @property
    def velocity(self) -> float | None:
        """
        How fast they move along the map, in places a frame; None if four lie on no line.

        A drive about as fast as the map's needs none, and of a slower one five frames say little.
        """
        ways: dict[float, Mapping[int, Likeliest]] = {}
        for one in self._kept[:-2]:
            newest = self._kept[-1]
            velocity = (newest.reference - one.reference) / (newest.frame - one.frame)
            if abs(velocity) > 1 + LIKELIEST.drift:
                ways[velocity] = self._on_way(newest.frame, velocity, drift=0.0)
        best = max(ways, key=lambda one: len(ways[one]), default=None)
        return best if best and len(ways[best]) >= LIKELIEST.on_line else None

    def recent_strength(self, frame: int, reference: int, direction: float = 1.0) -> float | None:
        """Return how strongly the newest frames verify a place, on average; None if none does."""
        on_way = self._on_way(frame, direction)
        is_near = self._places.is_near
        if 0 not in on_way or not is_near(reference, on_way[0].reference, TRACK.same_track):
            return None
        recent = [one.strength for past, one in on_way.items() if past < LIKELIEST.recent]
        return sum(recent) / len(recent)

    def _on_way(
        self, frame: int, velocity: float, drift: float = LIKELIEST.drift
    ) -> dict[int, Likeliest]:
        """Return the likeliest places that a robot may have come along, by frames ago."""
        if not self._kept or self._kept[-1].frame != frame:
            return {}
        newest = self._kept[-1].reference
        found: dict[int, Likeliest] = {}
        for end in (newest, *self._places.looks(newest)):
            first, last = self._places.bounds.span(end)
            for one in self._kept:
                past = frame - one.frame
                off = abs(end - one.reference - velocity * past)
                is_own = first <= one.reference < last
                if is_own and off <= LIKELIEST.same_scene + drift * past:
                    found[past] = one
        return found
