# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The recogniser once more over a drive, with what an earlier pass computed of its images."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from convseq_ros.config import Config
from convseq_ros.core.descriptor import nothing_seen
from convseq_ros.core.matching import Matcher
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.reference_map import ReferenceMap
from convseq_ros.core.types import Descriptor, Match, Reason
from convseq_ros.evaluation.drive import Drive
import numpy as np
import numpy.typing as npt


def part_of(whole: ReferenceMap, first: int, last: int) -> ReferenceMap:
    """Return a map of the references from `first` to before `last`."""
    part = ReferenceMap(whole.encoding)
    for index in range(first, last):
        part.add(whole.places[index], whole.packed(index))
    return part


def rerun(
    drive: Drive, reference_map: ReferenceMap, rows: npt.NDArray[np.float32], config: Config
) -> Iterator[Match]:
    """
    Yield the answer to every frame of a drive.

    Parameters
    ----------
    drive : Drive
        The query.
    reference_map : ReferenceMap
        The references, or a part of them.
    rows : ndarray of float32, shape (Q, R)
        Pair scores with these references; NaN where there is none.
    config : Config
        Sequence, search and acceptance may differ from those of the earlier pass.

    """
    matcher = _Remembered(drive, rows)
    recognizer = PlaceRecognizer(reference_map, config, matcher)
    unreadable = nothing_seen(config.encoding)
    for stamp_ns, readable, descriptor in zip(
        drive.stamps_ns, drive.readable, drive.descriptors, strict=True
    ):
        if readable:
            yield recognizer.recognize(stamp_ns, descriptor)
        else:
            match = recognizer.recognize(stamp_ns, unreadable)
            yield replace(match, reason=Reason.UNREADABLE)


class _Remembered(Matcher):
    """Looks scores up; a query is the index of its frame."""

    def __init__(self, drive: Drive, rows: npt.NDArray[np.float32]) -> None:
        self.kernel = 'remembered'
        self.exact = True
        self._index = {id(one): index for index, one in enumerate(drive.descriptors)}
        self._rows = rows

    def see(self, descriptor: Descriptor) -> int | None:
        return self._index[id(descriptor)]

    def scores(self, query: int, indices: npt.NDArray[np.int64]) -> npt.NDArray[np.float32]:
        return self._rows[query, indices]

    def exact_scores(
        self, query: int, indices: npt.NDArray[np.int64]
    ) -> npt.NDArray[np.float32]:
        return self._rows[query, indices]

    def shift(self, _query: int, _index: int) -> None:
        return None

    def scores_of(
        self, asked: Sequence[tuple[int, npt.NDArray[np.int64]]]
    ) -> list[npt.NDArray[np.float32]]:
        return [self.scores(query, indices) for query, indices in asked]

    def warm_up(self) -> None:
        pass
