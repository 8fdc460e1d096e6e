# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What scores pairs of a query and a place (paper III-D)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from convseq_ros.core.geometry.verification import NOTHING, overlap, PackedRegions, Verification
from convseq_ros.core.types import Descriptor, Indices, Row, Shift
import numpy as np
import numpy.typing as npt


@dataclass(frozen=True, slots=True)
class Features:
    """The features of a query."""

    scored: Any  # for pair scores
    packed: PackedRegions | None = None  # for the geometry
    rough: Any = None  # for rough scores


class Scorer:
    """
    Scores queries against the references of a map.

    Without methods of its own, a scorer has no rough scores, no shifts and no geometry.
    """

    kernel: str  # name of what computes the scores

    def reset(self) -> None:
        """Forget the drive."""

    def extract(self, descriptor: Descriptor) -> Features | None:
        """Return the features of a query, or None if it is uninformative."""
        raise NotImplementedError

    def scores_of(self, requests: Sequence[tuple[Features, Indices]]) -> list[Row]:
        """
        Return the pair scores of each query with its references, (n,), in [0, 1].

        The score of an uninformative reference is NaN. All references are read together.
        """
        raise NotImplementedError

    def rough_scores(self, _query: Features, _indices: Indices) -> Row | None:
        """Return rough scores (n,), 16 times faster; None if the query has none."""
        return None

    def shift(self, _query: Features, _index: int) -> Shift | None:
        """Return the shift from a query to a reference, rows and columns in cells, or None."""
        return None

    def packed(self, _index: int) -> PackedRegions | None:
        """Return a reference's regions for the geometry; None if uninformative or without any."""
        return None

    def field(self, _query: Features, _index: int, _shift: Shift) -> npt.NDArray[np.float64]:
        """Return the displacements of a query's regions, (n, 5), as `verification.field` does."""
        return np.zeros((0, 5))

    def overlap(self, query: Features, index: int) -> float | None:
        """Return the share of the views of a query and a reference that is common, in [0, 1]."""
        moved = self.verified(query, [index]).get(index, NOTHING).moved
        return None if moved is None or not query.packed else overlap(moved, query.packed.side)

    def verified(self, _query: Features, _indices: Sequence[int]) -> dict[int, Verification]:
        """Return the verification of a query with references, by index; empty without regions."""
        return {}

    def warm_up(self) -> None:
        """Make what all references need, if it is kept, so that no frame is late."""
