# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is compared of references, made when it is needed first."""

from collections.abc import Callable, Sequence
from itertools import islice
from threading import Lock
from typing import Any, TYPE_CHECKING

from convseq_ros.core.lots import Lots
import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from convseq_ros.core.map.reference_map import ReferenceMap

_READ_AT_ONCE = 256


class Prepared:
    """
    Reads references, prepares them and keeps the results.

    Parameters
    ----------
    reference_map : ReferenceMap
        The references.
    prepare : callable
        From the cells of one to what is compared of it.
    lots : Lots
        Who does the work.
    most : int, optional
        How many are kept, those that were asked for last; all by default.

    """

    def __init__(
        self,
        reference_map: 'ReferenceMap',
        prepare: Callable[[npt.NDArray[np.float32]], Any],
        lots: Lots,
        most: int | None = None,
    ) -> None:
        self._map = reference_map
        self._prepare = prepare
        self._lots = lots
        self._most = most
        self._lock = Lock()
        self._kept: dict[int, Any] = {}

    def clear(self) -> None:
        """Forget what was made."""
        with self._lock:
            self._kept.clear()

    def of(self, indices: Sequence[int]) -> list[Any]:
        """
        Return what is compared of references, None for each that shows nothing.

        Raises
        ------
        MapError
            If one is stored and damaged.

        """
        with self._lock:
            found = {index: self._kept[index] for index in indices if index in self._kept}
        missing = [index for index in dict.fromkeys(indices) if index not in found]
        for start in range(0, len(missing), _READ_AT_ONCE):
            some = missing[start : start + _READ_AT_ONCE]
            found.update(zip(some, self._made(some), strict=True))
        with self._lock:
            self._keep(found)
        return [found[index] for index in indices]

    def _made(self, indices: Sequence[int]) -> list[Any]:
        cells = self._map.cells_of(indices)
        made: list[Any] = [None] * len(cells)

        def prepare(_: int, lot: slice) -> None:
            for place in range(lot.start, lot.stop):
                if cells[place].any():
                    made[place] = self._prepare(cells[place])

        self._lots.run([len(cells)], prepare)
        return made

    def _keep(self, found: dict[int, Any]) -> None:
        """Keep what was found, the newest behind, and forget the oldest."""
        if self._most is not None:
            for index in found:
                self._kept.pop(index, None)
        self._kept.update(found)
        if self._most is not None:
            for index in [*islice(self._kept, max(0, len(self._kept) - self._most))]:
                del self._kept[index]
