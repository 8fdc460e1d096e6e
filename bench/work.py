# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a part of the bench is given, and the memory that it takes."""

from dataclasses import dataclass
from functools import cached_property
import os
from pathlib import Path

import numpy as np
import numpy.typing as npt

from bench import material


def resident_mb() -> float:
    """Return how much memory this process has."""
    pages = int(Path('/proc/self/statm').read_text(encoding='ascii').split()[1])
    return pages * os.sysconf('SC_PAGE_SIZE') / 1e6


@dataclass(frozen=True)
class Work:
    """Material, and how much of it to use."""

    folder: Path  # where the material is
    sizes: tuple[int, ...]  # of the maps, ascending
    threads: int  # that a part may use
    quick: bool  # whether only to see that everything runs

    def map_path(self, size: int) -> Path:
        """Return the map of a size."""
        return material.map_path(self.folder, size)

    def largest(self, most: int) -> int:
        """Return the size of the largest map of at most so many places."""
        return max(size for size in self.sizes if size <= most or size == self.sizes[0])

    @cached_property
    def images(self) -> npt.NDArray[np.uint8]:
        """Gray images of the second drive, (n, 480, 640)."""
        return material.read_queries(self.folder)
