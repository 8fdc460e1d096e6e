# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Ways to score a pair of images, and the matcher that scores a query in a map with one."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import islice
import os
from typing import Any, TYPE_CHECKING

from convseq_ros.config import MatchingConfig
from convseq_ros.core.encoding.entropy import MAX_BITS
from convseq_ros.core.lots import Lots
from convseq_ros.core.prepared import Prepared
from convseq_ros.core.similarity.background import Layout
from convseq_ros.core.similarity.choice import chosen_kernels
from convseq_ros.core.similarity.pair_score import PairScore, Regions
from convseq_ros.core.similarity.regional import similarity
from convseq_ros.core.types import Descriptor, Shift
import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from convseq_ros.core.map.reference_map import ReferenceMap

_MOST_THREADS = 2
_KEPT_TO_RESCORE = 64


@dataclass(frozen=True, slots=True)
class _Seen:
    """What is compared of a query, by the fast kernel and by an exact one."""

    fast: Any
    exact: Any


class Matcher:
    """
    Scores queries against references of a map, whose regions are rebuilt when they are needed.

    Parameters
    ----------
    reference_map : ReferenceMap
        The references; more may be added to it later.
    matching : MatchingConfig
        How pairs are scored, by which kernel and by how many threads.
    saliency_threshold : float
        Share of 8 bits of entropy that makes a region of a query salient.
    kept : int, optional
        References of which what is compared stays in memory (30 kB each by the 8-bit kernel, about
        120 kB by others); all by default.

    Attributes
    ----------
    kernel : str
        What computes `scores`: numbers and instructions.
    exact : bool
        Whether `scores` are those of the definition, to 1e-6, as `exact_scores` always are.

    Raises
    ------
    ConfigError
        If the machine cannot run the kernel that is asked for.

    """

    def __init__(
        self,
        reference_map: 'ReferenceMap',
        matching: MatchingConfig,
        saliency_threshold: float,
        kept: int | None = None,
    ) -> None:
        self._fast, self._exact = chosen_kernels(matching)
        self._map = reference_map
        self._least_bits = saliency_threshold * MAX_BITS
        usable = min(len(os.sched_getaffinity(0)), _MOST_THREADS)
        self._keeps_all = kept is None
        self._lots = Lots((matching.threads or usable) - 1)
        self._layout: Layout | None = None
        look = self._exact.look
        if look and matching.remove_layout:
            self._layout = Layout(reference_map, look.even, look.show)
        prepare = _preparing(self._fast, self._layout)
        self._prepared = Prepared(reference_map, prepare, self._lots, kept)
        self._prepared_to_rescore = self._prepared
        if self._exact is not self._fast:
            prepare = _preparing(self._exact, self._layout)
            self._prepared_to_rescore = Prepared(
                reference_map, prepare, self._lots, _KEPT_TO_RESCORE
            )
        self.kernel = self._fast.name
        self.exact = self._fast.exact

    def see(self, descriptor: Descriptor) -> Any:
        """Return what is compared of a query, each once, or None if it shows nothing."""
        usual = None
        if self._layout:
            self._follow_map(self._layout)
            descriptor = replace(descriptor, cells=self._layout.even(descriptor.cells))
            usual = self._layout.of_drive(descriptor.cells)
        return self._compared(descriptor, usual)

    def scores(self, query: Any, indices: npt.NDArray[np.int64]) -> npt.NDArray[np.float32]:
        """
        Return the pair scores of a query with some references.

        Parameters
        ----------
        query : object
            From `see`.
        indices : ndarray of int64, shape (n,)
            Of the references.

        Returns
        -------
        ndarray of float32, shape (n,)
            In [0, 1]; NaN for a reference that shows nothing.

        """
        return self.scores_of([(query, indices)])[0]

    def scores_of(
        self, asked: Sequence[tuple[Any, npt.NDArray[np.int64]]]
    ) -> list[npt.NDArray[np.float32]]:
        """Return what `scores` does for several queries, with all references read in one go."""
        pairs = [(query.fast, indices) for query, indices in asked]
        return self._scored(self._fast, self._prepared, pairs)

    def exact_scores(self, query: Any, indices: npt.NDArray[np.int64]) -> npt.NDArray[np.float32]:
        """Return what `scores` does, by the definition."""
        return self._scored(self._exact, self._prepared_to_rescore, [(query.exact, indices)])[0]

    def shift(self, query: Any, index: int) -> Shift | None:
        """Return rows and columns, in cells, from the query to a reference, if known."""
        (reference,) = self._prepared_to_rescore.of([index])
        if reference is None:
            return None
        shifts = self._exact.compare(query.exact, [reference])[1]
        return None if shifts is None else (float(shifts[0, 0]), float(shifts[0, 1]))

    def agreeing(self, query: Any, index: int, shift: Shift) -> npt.NDArray[np.float64]:
        """Return where the regions are that moved by a shift, (n, 4); see `Look.agree`."""
        cells, look = self._map.cells(index), self._exact.look
        if look is None or not cells.any():
            return np.zeros((0, 4))
        usual = None
        if self._layout:
            cells, usual = self._layout.even(cells), self._layout.of_map
        return look.agree(query.exact, look.show(cells, usual)[0], shift)

    def warm_up(self) -> None:
        """Compile or load what frames will need, so that the first is not late."""
        # These import this module.
        from convseq_ros.core.map.map_format import decode_cells, encode_cells
        from convseq_ros.core.map.reference_map import pack_cells, unpack_cells

        shape = self._map.cell_shape
        side = shape[0]
        packed = pack_cells(np.random.default_rng(0).random(shape, np.float32))
        cells = unpack_cells(decode_cells(encode_cells(packed), shape))
        drawn = Descriptor(
            cells, np.ones((side - 1) ** 2, np.bool_), np.full((side, side), MAX_BITS), 0.5
        )
        usual = None
        look = self._exact.look
        if self._layout and look:
            self._follow_map(self._layout)
            usual, _ = look.show(look.even(cells[::-1]), None)
        query = self._compared(drawn, usual)
        similarity(drawn, drawn)
        for pair, own in ((self._fast, query.fast), (self._exact, query.exact)):
            pair.compare(own, [pair.prepare(cells, usual)])
        if self._keeps_all:
            self._prepared.of(range(len(self._map)))

    def _compared(self, descriptor: Descriptor, usual: Regions | None) -> Any:
        fast = self._fast.see(descriptor, self._least_bits, usual)
        if fast is None:
            return None
        exact = fast if self.exact else self._exact.see(descriptor, self._least_bits, usual)
        return _Seen(fast, exact)

    def _follow_map(self, layout: Layout) -> None:
        if layout.renew():
            self._prepared.clear()
            self._prepared_to_rescore.clear()

    def _scored(
        self,
        pair: PairScore,
        prepared: Prepared,
        asked: Sequence[tuple[Any, npt.NDArray[np.int64]]],
    ) -> list[npt.NDArray[np.float32]]:
        references = iter(prepared.of([index for _, some in asked for index in some.tolist()]))
        work = [(own, [*islice(references, len(some))]) for own, some in asked]
        found = [np.full(len(some), np.nan, np.float32) for _, some in work]

        def score(piece: int, lot: slice) -> None:
            own, some = work[piece]
            shown = [one for one in some[lot] if one is not None]
            if shown:
                there = [one is not None for one in some[lot]]
                found[piece][lot][there] = pair.compare(own, shown)[0]

        self._lots.run([len(some) for _, some in work], score)
        return found


def _preparing(pair: PairScore, layout: Layout | None) -> Callable[[Regions], Any]:
    def prepare(cells: Regions) -> Any:
        if layout:
            return pair.prepare(layout.even(cells), layout.of_map)
        return pair.prepare(cells, None)

    return prepare
