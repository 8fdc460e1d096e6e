# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's regions and pair score (III-C, III-D), in float32."""

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache

from convseq_ros.core.encoding.regions import Cells, joined_regions, Regions
from convseq_ros.core.map.place import unpack_cells
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.similarity.scorer import Features, Scorer
from convseq_ros.core.types import Descriptor, Floats, Indices, Row
import numpy as np

_SPAN = 2  # cells in a row of a region (III-C)
_READ_AT_ONCE = 256  # references that are read at once, for 8 MB of cells
_KEPT = 32  # descriptors whose regions are cached; more than `max_overlap_length`
_KEPT_PAIRS = 20_000  # of images whose similarities are cached; 80 MB


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


@dataclass(frozen=True, eq=False, slots=True)
class _Image:
    """The cells of a query, and all of its regions; equal to itself only."""

    cells: Cells
    regions: Regions


class PaperMatcher(Scorer):
    """
    Scores queries against the references of a map; keeps their regions, 123 kB each.

    Each frame of a sequence is scored with the salient regions of the newest (III-D), so an image
    is compared with a reference again and again, by other regions of it. What is kept of a pair
    is how similar each region of the image is to the most similar one of the reference.
    """

    def __init__(self, reference_map: ReferenceMap) -> None:
        self.kernel, self._map = 'numpy', reference_map
        kept = self._kept = dict[int, Regions | None]()  # by reference; None for blank ones
        self._images = deque[_Image](maxlen=_KEPT)

        @lru_cache(_KEPT_PAIRS)
        def similarities(image: _Image, index: int) -> Floats | None:
            regions = kept[index]
            if regions is None:
                return None
            return np.asarray((image.regions @ regions.T).max(axis=1))

        self._similarities = similarities

    def extract(self, descriptor: Descriptor) -> Features | None:
        if not descriptor.informative:
            return None
        image = next((one for one in self._images if one.cells is descriptor.cells), None)
        if image is None:
            image = _Image(descriptor.cells, paper_regions(descriptor.cells))
            self._images.append(image)
        return Features((image, descriptor.salient))

    def scores_of(self, requests: Sequence[tuple[Features, Indices]]) -> list[Row]:
        self._keep(index for _, indices in requests for index in indices.tolist())
        rows = [np.full(len(indices), np.nan, np.float32) for _, indices in requests]
        for row, (query, indices) in zip(rows, requests, strict=True):
            image, salient = query.scored
            for at, index in enumerate(indices.tolist()):
                if (similarities := self._similarities(image, index)) is not None:
                    row[at] = min(float(similarities[salient].mean()), 1.0)
        return rows

    def _keep(self, indices: Iterable[int]) -> None:
        missing = [index for index in dict.fromkeys(indices) if index not in self._kept]
        for start in range(0, len(missing), _READ_AT_ONCE):
            batch = missing[start : start + _READ_AT_ONCE]
            for index, packed in zip(batch, self._map.packed_of(batch), strict=True):
                cells = unpack_cells(packed)
                self._kept[index] = paper_regions(cells) if cells.any() else None

    def warm_up(self) -> None:
        self._keep(range(len(self._map)))
