# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's pair score (III-D) by NumPy: the definition, and the fallback without C."""

from collections.abc import Iterable, Sequence

from convseq_ros.core.encoding.regions import Cells, paper_regions, Regions
from convseq_ros.core.similarity.pair_score import PairScore, Scores
from convseq_ros.core.types import Descriptor
import numpy as np
import numpy.typing as npt


def pair_scores(query: Descriptor, references: Iterable[Regions]) -> npt.NDArray[np.float32]:
    """
    Return how similar a query is to each reference.

    For every salient region of the query the most similar region anywhere in the reference counts;
    the score is the mean of these similarities (paper III-D).

    Parameters
    ----------
    query : Descriptor
        With at least one salient region.
    references : iterable of R ndarrays of float32, shape (N, 4 * bins)
        From `paper_regions`. The result, (R,), lies in [0, 1]; it is not symmetric.

    """
    return _compare(paper_regions(query.cells)[query.salient], list(references))[0]


def _extract(query: Descriptor, _least_bits: float, _shown: object) -> Regions | None:
    return paper_regions(query.cells)[query.salient] if query.informative else None


def _prepare(cells: Cells, _background: object) -> Regions:
    return paper_regions(cells)


def _compare(salient: Regions, references: Sequence[Regions]) -> Scores:
    scores = [min(float((salient @ one.T).max(axis=1).mean()), 1.0) for one in references]
    return np.array(scores, np.float32), None


REGIONAL = PairScore('numpy', True, _extract, _prepare, _compare)
