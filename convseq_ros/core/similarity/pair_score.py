# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a way to score a pair of images consists of."""

from collections.abc import Callable, Sequence
from typing import Any

from convseq_ros.core.encoding.regions import Cells, Regions
from convseq_ros.core.map.place import Packed, unpack_cells
from convseq_ros.core.types import Descriptor, Doubles, Floats

# In [0, 1], (n,), and shifts in cells, rows and columns, (n, 2), if the kernel tells.
Scores = tuple[Floats, Doubles | None]
# Regions as they are compared, (N, 32), and their blocks, None without a background.
Shown = tuple[Regions, Any]


class PairScore:
    """One kernel; another one replaces all of this together."""

    name: str
    exact: bool  # whether scores are those of the definition, to 1e-6
    # From cells to normalised ones, from these to regions, and from regions and a background to
    # those that are compared. Only where a background can be subtracted.
    normalize: Callable[[Cells], Cells] | None = None
    project: Callable[..., Regions] | None = None
    subtract: Callable[[Regions, Regions | None], Shown] | None = None
    # From a reference, as it is compared, to its regions (N, 32).
    regions_of: Callable[[Any], Regions] | None = None
    rough: 'PairScore | None' = None  # the same by a sixteenth of the work, with rough scores

    def extract(self, query: Descriptor, least_bits: float, shown: Shown | None) -> Any:
        """
        Return what is compared of a query; None if it shows nothing.

        Regions are salient from so many bits of entropy on; `shown` are all, if they are known.
        """
        raise NotImplementedError

    def prepare(self, cells: Cells, background: Regions | None) -> Any:
        """Return what is compared of a reference, given its map's background."""
        raise NotImplementedError

    def prepare_packed(
        self, packed: Sequence[Packed], normalizes: bool, background: Regions | None
    ) -> list[Any]:
        """Return that of several, from their packed cells; None of one that shows nothing."""
        normalize = (normalizes and self.normalize) or (lambda cells: cells)
        every = map(unpack_cells, packed)
        return [self.prepare(normalize(one), background) if one.any() else None for one in every]

    def compare(self, query: Any, references: Sequence[Any]) -> Scores:
        """Return the scores and shifts of a query and n references."""
        raise NotImplementedError
