# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's pair score by NumPy (III-D): the definition, and the fallback without C."""

from collections.abc import Sequence

from convseq_ros.core.encoding.regions import Cells, paper_regions, Regions
from convseq_ros.core.similarity.pair_score import PairScore, Scores, spread, SURE
from convseq_ros.core.types import Descriptor, Floats
import numpy as np


def pair_scores(salient: Regions, references: Sequence[Regions]) -> Floats:
    """
    Return how similar a query is to each of R references, (R,), in [0, 1]; it is not symmetric.

    The score is the mean, over the salient regions of the query (G, 32), of the similarity to the
    most similar region anywhere in the reference (N, 32); both are from `paper_regions` (paper
    III-D).
    """
    scores = [min(float((salient @ each.T).max(axis=1).mean()), 1.0) for each in references]
    return np.array(scores, np.float32)


def score_beside(limit: float, salient: Regions, reference: Regions) -> float:
    """Return `pair_scores` over the first regions (G, 32), as many as decide the limit's side."""
    best = np.zeros(0)
    for first in range(0, len(salient), SURE.regions):
        most = (salient[first : first + SURE.regions] @ reference.T).max(axis=1)
        best = np.append(best, most)
        variance = best.var() / len(best) * (1 - len(best) / len(salient))
        if (best.mean() - limit) ** 2 > SURE.errors**2 * variance:
            break
    return min(float(best.mean()), 1.0)


class NumpyRegional(PairScore):
    """The definition as a kernel."""

    name, exact = 'numpy', True

    def extract(self, query: Descriptor, _least_bits: float, _regions: object) -> Regions | None:
        return paper_regions(query.cells)[query.salient] if query.informative else None

    def prepare(self, cells: Cells, _background: object) -> Regions:
        return paper_regions(cells)

    def compare(
        self, query: Regions, references: Sequence[Regions], limit: float | None = None
    ) -> Scores:
        if limit is None:
            return pair_scores(query, references), None
        salient = spread(query)
        scores = [score_beside(limit, salient, reference) for reference in references]
        return np.array(scores, np.float32), None
