# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a part of the bench is given."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from convseq_ros.config import MatchingConfig
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.matcher import Matcher
from convseq_ros.core.types import Descriptor
from convseq_ros.errors import ConfigError
import numpy as np
import numpy.typing as npt

from bench import material
from bench.clock import in_turn, Times
from bench.finding import Finding

_REST_S = 0.2
KERNELS = ('int8', 'float32', 'numpy')


@dataclass(frozen=True)
class Work:
    """
    Material, and how much of it to use.

    Parameters
    ----------
    folder : Path
        Where the material is.
    sizes : tuple of int
        Of the maps, ascending.
    threads : int
        That a part may use.
    quick : bool
        Whether only to see that everything runs.

    """

    folder: Path
    sizes: tuple[int, ...]
    threads: int
    quick: bool

    def in_turn(
        self, sides: Mapping[str, Callable[[], object]], budget_s: float
    ) -> dict[str, Times]:
        """Return the times of some sides, as `clock.in_turn` does; of one round if quick."""
        if self.quick:
            return in_turn(sides, 0, fewest=1, sample_ms=0)
        return in_turn(sides, budget_s, rest_s=_REST_S if self.threads > 1 else 0.0)

    def map_path(self, size: int) -> Path:
        """Return the map of a size."""
        return material.map_path(self.folder, size)

    @cached_property
    def images(self) -> npt.NDArray[np.uint8]:
        """Gray images of the second drive, (n, 480, 640)."""
        return material.read_queries(self.folder)

    @cached_property
    def queries(self) -> list[Descriptor]:
        """The descriptors of a few of them."""
        return [describe(image) for image in self.images[:: max(1, len(self.images) // 8)]]

    @cached_property
    def kernels(self) -> tuple[str, ...]:
        """What can compute pair scores here, fastest first."""
        return tuple(kernel for kernel in KERNELS if not _obstacle(kernel))

    def absent_kernels(self, what: str) -> list[Finding]:
        """Return a line for each kernel that cannot be measured here."""
        return [
            Finding(what=what, side=f'{kernel} kernel', threads=self.threads, note=why)
            for kernel in KERNELS
            if (why := _obstacle(kernel))
        ]


def _obstacle(kernel: str) -> str:
    """Return why a kernel does not run here; empty if it does."""
    try:
        Matcher(ReferenceMap(), MatchingConfig(kernel=kernel), 0.5)
    except ConfigError as error:
        return str(error)
    return ''
