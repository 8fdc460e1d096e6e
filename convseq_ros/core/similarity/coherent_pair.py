# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Coherent matching of a drive with a map: shares of regions, and how alike whole images are."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from convseq_ros.core.similarity.background import unusual
from convseq_ros.core.similarity.cell_normalization import evened
from convseq_ros.core.similarity.coherent import (
    agreeing_regions,
    coherent_score,
    CoherentQuery,
    projected_regions,
    Regions,
    see,
)
from convseq_ros.core.similarity.global_similarity import likeness, moved, Whole, whole
from convseq_ros.core.similarity.pair_score import Look, PairScore, Scores
from convseq_ros.core.types import Descriptor, Shift
import numpy as np
import numpy.typing as npt

Cells = npt.NDArray[np.float32]
Show = Callable[[Cells, Regions | None], tuple[Regions, Whole | None]]


@dataclass(frozen=True, slots=True)
class _Query:
    """What is compared of a query, and its moved images if the layout is known."""

    seen: CoherentQuery
    packed: Any
    images: npt.NDArray[np.float64] | None


@dataclass(frozen=True, slots=True)
class _Reference:
    """What is compared of a reference, and its image if the layout is known."""

    packed: Any
    image: Whole | None


def coherent_pair(
    name: str,
    exact: bool,
    even: Callable[[Cells], Cells],
    show: Show,
    pack_query: Callable[[CoherentQuery], Any],
    pack_reference: Callable[[Regions], Any],
    compare: Callable[[Any, Sequence[Any]], Scores],
) -> PairScore:
    """
    Return the pair score that a kernel computes.

    Parameters
    ----------
    name, exact : str, bool
        As in `PairScore`.
    even, show : callable
        As in `Look`: compute `evened` and `shown`.
    pack_query, pack_reference : callable
        To what the kernel compares.
    compare : callable
        Computes `coherent_score` of a query and some references.

    Returns
    -------
    PairScore
        Its scores are those of `coherent_score` as long as nothing is known of what is usual. With
        that, regions are `unusual` ones, and up to half of the score is lost as the whole images
        are less alike at their best shift.

    """

    def seen(query: Descriptor, least_bits: float, usual: Regions | None) -> _Query | None:
        regions, image = show(query.cells, usual)
        found = see(query, least_bits, regions)
        if found is None:
            return None
        images = None if image is None else moved(image, found.side)
        return _Query(found, pack_query(found), images)

    def prepare(cells: Cells, usual: Regions | None) -> _Reference:
        regions, image = show(cells, usual)
        return _Reference(pack_reference(regions), image)

    def score(query: _Query, references: Sequence[_Reference]) -> Scores:
        shares, shifts = compare(query.packed, [one.packed for one in references])
        images = [one.image for one in references]
        if query.images is None or any(image is None for image in images):
            return shares, shifts
        alike = likeness(query.images, np.array(images, np.float64))
        return shares * (0.5 + 0.5 * alike), shifts

    def agree(query: _Query, reference: Regions, shift: Shift) -> npt.NDArray[np.float64]:
        return agreeing_regions(query.seen, reference, shift)

    return PairScore(name, exact, seen, prepare, score, Look(even, show, agree))


def shown(cells: Cells, usual: Regions | None) -> tuple[Regions, Whole | None]:
    """Return the regions of an image that are compared, and the `whole` where layout is known."""
    regions = unusual(projected_regions(cells), usual)
    return regions, None if usual is None else whole(regions)


def _same(what: Any) -> Any:
    return what


def _compare(query: CoherentQuery, references: Sequence[Regions]) -> Scores:
    scores, shifts = zip(*(coherent_score(query, one) for one in references), strict=True)
    return np.array(scores, np.float32), np.array(shifts)


COHERENT = coherent_pair('numpy', True, evened, shown, _same, _same, _compare)
