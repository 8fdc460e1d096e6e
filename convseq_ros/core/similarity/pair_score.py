# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The interface of a kernel that scores pairs of images."""

from collections.abc import Callable, Sequence
from typing import Any

from convseq_ros.core.encoding.regions import Cells, Regions
from convseq_ros.core.map.place import Packed, unpack_cells
from convseq_ros.core.types import constants, Descriptor, Doubles, Floats
import numpy as np

# Scores (n,) in [0, 1], and shifts (n, 2), rows and columns in cells, if the kernel has them.
Scores = tuple[Floats, Doubles | None]
# Regions (N, 32) less the background, and their blocks; None without a background.
Foreground = tuple[Regions, Any]


@constants
class SURE:
    """When the mean over part of the regions decides on which side of a limit the score lies."""

    regions: int = 120  # between two tests of the mean: entire tiles of every kernel
    # Distance of the mean from the limit, in standard errors. With 3, all of 2,263 pairs of seven
    # drives are decided correctly; with 4, half of the regions are scored (docs/NOTES.md).
    errors: float = 4.0


def spread(salient: Regions) -> Regions:
    """Return regions (G, 32) reordered so that the first ones are spread over the image."""
    return np.concatenate([salient[first::8] for first in (0, 4, 2, 6, 1, 5, 3, 7)])


class PairScore:
    """A kernel: its features of queries and references, and their scores."""

    name: str
    exact: bool  # whether scores equal the definition to 1e-6
    # The steps from cells to normalised cells, to regions, and to regions less a background. None
    # if the kernel cannot subtract a background.
    normalize: Callable[[Cells], Cells] | None = None
    project: Callable[..., Regions] | None = None
    subtract: Callable[[Regions, Regions | None], Foreground] | None = None
    # From the features of a reference to its regions (N, 32).
    regions_of: Callable[[Any], Regions] | None = None
    rough: 'PairScore | None' = None  # a kernel of rough scores, for 1/16 of the work

    def extract(self, query: Descriptor, least_bits: float, regions: Foreground | None) -> Any:
        """
        Return the features of a query; None if it is not informative.

        A region is salient from `least_bits` of entropy on. `regions` are all of its regions, if
        computed.
        """
        raise NotImplementedError

    def prepare(self, cells: Cells, background: Regions | None) -> Any:
        """Return the features of a reference, given its map's background."""
        raise NotImplementedError

    def prepare_packed(
        self, packed: Sequence[Packed], normalizes: bool, background: Regions | None
    ) -> list[Any]:
        """Return the features of references from their packed cells; None for blank ones."""
        normalize = (normalizes and self.normalize) or (lambda cells: cells)
        every = map(unpack_cells, packed)
        return [self.prepare(normalize(it), background) if it.any() else None for it in every]

    def compare(self, query: Any, references: Sequence[Any], limit: float | None = None) -> Scores:
        """
        Return the scores and shifts of a query and n references.

        With a `limit`, a kernel may score part of a query's regions, if that decides the side.
        """
        raise NotImplementedError
