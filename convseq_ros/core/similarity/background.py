# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What a drive usually shows, region by region of the image.

All images of one road or corridor have the same layout: the ground below, walls that run to the
middle. So regions find counterparts where they lie themselves, at the right place as elsewhere.
What is usual is therefore subtracted: of references what their map shows on average, of queries
what their own drive does, since at night the same layout looks otherwise.
"""

from collections.abc import Callable
from typing import Any, TYPE_CHECKING

from convseq_ros.core.encoding.unit import unit
import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from convseq_ros.core.map.reference_map import ReferenceMap

_FEWEST = 20
_SAMPLE = 256
_PRIOR_FRAMES = 5
_STILL_ALIKE = 0.8

Cells = npt.NDArray[np.float32]
Regions = npt.NDArray[np.float32]
Even = Callable[[Cells], Cells]
Show = Callable[[Cells, Regions | None], tuple[Regions, Any]]


def unusual(regions: Regions, usual: Regions | None) -> Regions:
    """Return regions, (N, 32), less what is usual there, of unit length; as they are if None."""
    return regions if usual is None else unit(regions - usual)


class Layout:
    """
    What is usual in a map, and in the drive that is matched with it.

    Parameters
    ----------
    reference_map : ReferenceMap
        At most 256 of its references are looked at, evenly spread, and others whenever the map
        has doubled. Nothing is known of maps of less than 20 places.
    even, show : callable
        As in `Look`.

    Attributes
    ----------
    even : callable
        What is done to all cells first.
    of_map : ndarray of float32, shape (N, 32), or None
        The mean of the references' regions.

    """

    def __init__(self, reference_map: 'ReferenceMap', even: Even, show: Show) -> None:
        self.even = even
        self.of_map: Regions | None = None
        self._map = reference_map
        self._show = show
        self._averaged = 0
        self._last: Regions | None = None
        self._sum = np.zeros(1, np.float32)
        self._frames = 0

    def renew(self) -> bool:
        """Look at the map again if it has doubled, and return whether `of_map` has changed."""
        count = len(self._map)
        if count < max(_FEWEST, 2 * self._averaged):
            return False
        some = np.unique(np.linspace(0, count - 1, min(count, _SAMPLE)).astype(int)).tolist()
        read = [self.even(cells) for cells in self._map.cells_of(some) if cells.any()]
        shown = [self._show(cells, None)[0] for cells in read]
        self.of_map = np.mean(shown, axis=0) if shown else None
        self._averaged = count
        return True

    def of_drive(self, cells: Cells) -> Regions | None:
        """
        Return what was usual up to a query, (N, 32), None for as long as `of_map` is.

        Parameters
        ----------
        cells : ndarray of float32, shape (S, S, 8)
            Of the query, from `even`; each frame comes once. The mean of the map counts as 5
            frames, and a frame that is still much like the last that counted does not count.

        """
        regions, _ = self._show(cells, None)
        if self._last is None or np.vdot(regions, self._last) < _STILL_ALIKE * len(regions):
            self._last, self._sum = regions, self._sum + regions
            self._frames += 1
        if self.of_map is None:
            return None
        total = self._sum + _PRIOR_FRAMES * self.of_map
        return np.asarray(total / (self._frames + _PRIOR_FRAMES), np.float32)
