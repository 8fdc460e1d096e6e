# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a way to score a pair of images consists of."""

from collections.abc import Callable, Sequence
from typing import Any

from convseq_ros.core.encoding.regions import Cells, Regions
from convseq_ros.core.map.place import Packed, unpack_cells
from convseq_ros.core.types import constants, Descriptor, Doubles, Floats
import numpy as np

# In [0, 1], (n,), and shifts in cells, rows and columns, (n, 2), if the kernel tells.
Scores = tuple[Floats, Doubles | None]
# Regions as they are compared, (N, 32), and their blocks, None without a background.
Shown = tuple[Regions, Any]


@constants
class SURE:
    """When the mean of some regions shows on which side of a limit that of all lies."""

    regions: int = 120  # between two looks at the mean: whole tiles of every kernel
    # Standard errors off the limit. With 3, all of 2,263 pairs of seven drives are told right, and
    # with 4 half of the regions are scored (docs/NOTES.md).
    errors: float = 4.0


def spread(salient: Regions) -> Regions:
    """Return regions (G, 32) in an order of which each beginning is spread over the image."""
    return np.concatenate([salient[first::8] for first in (0, 4, 2, 6, 1, 5, 3, 7)])


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

    def compare(self, query: Any, references: Sequence[Any], limit: float | None = None) -> Scores:
        """
        Return the scores and shifts of a query and n references.

        With a `limit`, a kernel may score part of a query, if that shows on which side it lies.
        """
        raise NotImplementedError
