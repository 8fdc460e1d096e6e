# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A drawn drive in place of a folder of images, named by a few numbers."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

from convseq_ros.core.types import Frame
from convseq_ros.simulation.drive import draw, Drive
from convseq_ros.simulation.street import Street


@dataclass(frozen=True, slots=True)
class SimulatedDrive(Drive):
    """Images that are drawn when they are first read; the same every time."""

    street: int = 0  # seed of the street, which is as long as the drive

    def __post_init__(self) -> None:
        Drive.__post_init__(self)
        Street(1.0, self.street)

    def __iter__(self) -> Iterator[Frame]:
        return iter(_drawn(self))


@lru_cache(maxsize=2)
def _drawn(drive: SimulatedDrive) -> tuple[Frame, ...]:
    """Return all frames: a drive is read for each method, and drawing takes longer than that."""
    furthest_m = max(drive.start_m, drive.distance_m(drive.num_frames))
    street = Street(furthest_m + 1.0, drive.street)
    return tuple(shot.frame for shot in draw(street, drive))
