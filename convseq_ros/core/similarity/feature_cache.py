# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The features of references, computed on first use, and their scores."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.similarity.background import Background
from convseq_ros.core.similarity.coherent import CoherentPair
from convseq_ros.core.similarity.threads import Threads
from convseq_ros.core.types import Indices, Row, Shift
import numpy as np

_READ_AT_ONCE = 256  # references that are read at once, for 8 MB of cells


@dataclass(eq=False, slots=True)
class FeatureCache:
    """Computes a kernel's features of references; keeps all, or the `_most` recently used."""

    _map: ReferenceMap
    pair: CoherentPair
    _background: Background
    _threads: Threads
    _most: int | None
    _kept: dict[int, Any] = field(default_factory=dict)
    _query: Any = None  # the first query of the last request, whose shifts are kept
    _shifts: dict[int, Shift] = field(default_factory=dict)  # by reference

    def clear(self) -> None:
        self._kept.clear()
        self._query = None

    def of(self, indices: Sequence[int]) -> list[Any]:
        """Return the features of references, None for blank ones; MapError if unreadable."""
        features = {index: self._kept[index] for index in indices if index in self._kept}
        missing = iter([index for index in dict.fromkeys(indices) if index not in features])
        while batch := [*islice(missing, _READ_AT_ONCE)]:
            features.update(zip(batch, self._made(batch), strict=True))
        if self._most is not None:  # move recently used ones to the end
            for index in features:
                self._kept.pop(index, None)
        self._kept.update(features)
        most = len(self._kept) if self._most is None else self._most
        for index in [*islice(self._kept, max(0, len(self._kept) - most))]:
            del self._kept[index]
        return [features[index] for index in indices]

    def scores_of(self, requests: Sequence[tuple[Any, Indices]]) -> list[Row]:
        """Return the scores of each query with its references; NaN for blank references."""
        features = iter(self.of([index for _, places in requests for index in places.tolist()]))
        work = [(query, [*islice(features, len(places))]) for query, places in requests]
        results = [np.full(len(references), np.nan, np.float32) for _, references in work]
        if requests:
            self._begin(requests[0][0])

        def score(request: int, batch: slice) -> None:
            query, references = work[request]
            kept = [at for at in range(batch.start, batch.stop) if references[at] is not None]
            if kept:
                scores, shifts = self.pair.compare(query, [references[at] for at in kept])
                results[request][kept] = scores
                if query is self._query:
                    indices = requests[request][1][kept].tolist()
                    self._shifts.update(zip(indices, map(tuple, shifts.tolist()), strict=True))

        self._threads.run([len(references) for _, references in work], score)
        return results

    def _begin(self, query: Any) -> None:
        if query is not self._query:
            self._query, self._shifts = query, {}

    def shifts(self, query: Any, indices: Sequence[int]) -> list[Shift | None]:
        """Return shifts from a query to references, rows and columns in cells, if known."""
        self._begin(query)
        unknown = [index for index in indices if index not in self._shifts]
        self.scores_of([(query, np.array(unknown, np.int64))])  # fills in `_shifts`
        return [self._shifts.get(index) for index in indices]

    def _made(self, indices: Sequence[int]) -> list[Any]:
        packed, background = self._map.packed_of(indices), self._background.of_map
        features: list[Any] = [None] * len(packed)

        def prepare(_: int, part: slice) -> None:
            features[part] = self.pair.prepare_packed(packed[part], background)

        self._threads.run([len(packed)], prepare)
        return features
