# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's regions and pair score (III-C, III-D), in float32."""

from collections.abc import Iterable, Sequence
from functools import lru_cache

from convseq_ros.core.encoding.regions import Cells, joined_regions, Regions
from convseq_ros.core.map.place import unpack_cells
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.similarity.matcher import Features, Matcher
from convseq_ros.core.types import Descriptor, Floats, Indices, Row, Shift
import numpy as np

_SPAN = 2  # cells in a row of a region (III-C)
_READ_AT_ONCE = 256  # references that are read at once, for 8 MB of cells
_KEPT = 32  # descriptors whose regions are cached; more than `max_overlap_length`


def paper_regions(cells: Cells) -> Regions:
    """Return the 2 x 2-cell regions ((S - 1)^2, 32) of cells; 0 without gradient (III-C)."""
    return joined_regions(cells, _SPAN)


def pair_scores(salient: Regions, references: Sequence[Regions]) -> Floats:
    """
    Return how similar a query is to each of R references, (R,), in [0, 1]; it is not symmetric.

    The score is the mean, over the salient regions of the query (G, 32), of the similarity to the
    most similar region anywhere in the reference (N, 32); both are from `paper_regions` (III-D).
    """
    scores = [min(float((salient @ each.T).max(axis=1).mean()), 1.0) for each in references]
    return np.array(scores, np.float32)


class PaperSimilarity:
    """The pair score of a query and another image; 0 if the query is not informative."""

    def __init__(self) -> None:
        self._regions = lru_cache(_KEPT)(lambda image: paper_regions(image.cells))

    def __call__(self, query: Descriptor, other: Descriptor) -> float:
        """Return the score, in [0, 1]."""
        if not query.informative:
            return 0.0
        return float(pair_scores(self._regions(query)[query.salient], [self._regions(other)])[0])


class PaperMatcher(Matcher):
    """Scores queries against the references of a map; keeps their regions, 123 kB each."""

    def __init__(self, reference_map: ReferenceMap) -> None:
        self.kernel, self._map = 'numpy', reference_map
        self._kept = dict[int, Regions | None]()  # by reference; None for blank ones

    def reset(self) -> None: ...

    def extract(self, descriptor: Descriptor) -> Features | None:
        """Return the salient regions of a query, or None if it is uninformative."""
        if not descriptor.informative:
            return None
        return Features(paper_regions(descriptor.cells)[descriptor.salient])

    def scores_of(self, requests: Sequence[tuple[Features, Indices]]) -> list[Row]:
        """Return the pair scores of each query with its references, (n,); NaN for blank ones."""
        self._keep(index for _, indices in requests for index in indices.tolist())
        rows = [np.full(len(indices), np.nan, np.float32) for _, indices in requests]
        for row, (query, indices) in zip(rows, requests, strict=True):
            for at, index in enumerate(indices.tolist()):
                if (regions := self._kept[index]) is not None:
                    row[at] = pair_scores(query.scored, [regions])[0]
        return rows

    def _keep(self, indices: Iterable[int]) -> None:
        missing = [index for index in dict.fromkeys(indices) if index not in self._kept]
        for start in range(0, len(missing), _READ_AT_ONCE):
            batch = missing[start : start + _READ_AT_ONCE]
            for index, packed in zip(batch, self._map.packed_of(batch), strict=True):
                cells = unpack_cells(packed)
                self._kept[index] = paper_regions(cells) if cells.any() else None

    def shift(self, _query: Features, _index: int) -> Shift | None:
        """Return None: the score gives no shift."""
        return None

    def packed(self, _index: int) -> None:
        """Return None: there are no regions for the geometry."""

    def warm_up(self) -> None:
        """Make the regions of all references, so that no frame is late."""
        self._keep(range(len(self._map)))
