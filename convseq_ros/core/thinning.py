# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which places of a session the other sessions of its map can do without."""

from collections.abc import Iterable
from dataclasses import dataclass

from convseq_ros.core.constants import constants
from convseq_ros.core.linking import recognised
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Match, Reason
import numpy as np
import numpy.typing as npt

_SURE = frozenset({Reason.ACCEPTED, Reason.COOL_DOWN})


@constants
class THINNING:
    """Of what is left out; by drawn drives of one town (docs/MATCHING.md)."""

    # Share of the regions that move alike, above which two looks are alike: on drawn streets .64
    # between two nights and .7 and more between days, clouds and evenings, but .52 between night
    # and day.
    alike: float = 0.55
    least_confidence: float = 0.95
    window: int = 16  # places to either side over which that is asked, and that are kept for it


@dataclass(frozen=True, slots=True)
class Needed:
    """The places of a session that are to be kept, and why the others are not."""

    runs: tuple[range, ...]  # of indices in the map
    unknown: int  # places that no other session is sure of
    unlike: int  # places that another session is sure of, but that look otherwise there
    known: int  # places that another session is sure of, and that look alike there


def needed(whole: ReferenceMap, session: int) -> Needed:
    """
    Return which places of a session the others could not answer as well for.

    A place is known if the others recognise it surely, at `least_confidence`, and it looks alike
    there. Where half of the places within `window` are known, a place can be done without; the
    others are kept, with so many places before and after, as sequences take them.
    """
    found = list(recognised(whole, session))
    if not found:
        return Needed((), 0, 0, 0)
    regions = (whole.cell_shape[0] - 2) ** 2  # of 3 x 3 cells
    sure = [_is_sure(match) for _, match in found]
    alike = [
        is_sure and _inliers(match) >= THINNING.alike * regions
        for is_sure, (_, match) in zip(sure, found, strict=True)
    ]
    around = np.ones(2 * THINNING.window + 1)
    share = _sums(alike, around) / _sums(np.ones(len(found)), around)
    kept = _sums(share < 0.5, around) > 0
    first = found[0][0]
    return Needed(
        tuple(range(first + run.start, first + run.stop) for run in _runs(kept)),
        sure.count(False),
        sure.count(True) - sum(alike),
        sum(alike),
    )


def _is_sure(match: Match) -> bool:
    is_sure = match.confidence is not None and match.confidence >= THINNING.least_confidence
    return match.reason in _SURE and is_sure


def _inliers(match: Match) -> int:
    return (match.best.inliers or 0) if match.best else 0


def _sums(values: npt.ArrayLike, around: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    middle = len(around) // 2
    return np.convolve(np.asarray(values, np.float64), around)[middle:-middle]


def _runs(kept: Iterable[bool]) -> list[range]:
    """Return the stretches that are kept."""
    edges = np.flatnonzero(np.diff([False, *kept, False]))
    return [range(start, stop) for start, stop in edges.reshape(-1, 2).tolist()]
