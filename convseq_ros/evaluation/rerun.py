# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The recogniser once more over a drive, with what an earlier pass computed of its images."""

from collections.abc import Iterator

from convseq_ros.config import Config
from convseq_ros.core.recognizer import _Seen, PlaceRecognizer
from convseq_ros.core.reference_map import ReferenceMap
from convseq_ros.core.types import Frame, Match
from convseq_ros.evaluation.drive import Drive
import numpy as np
import numpy.typing as npt

_SOMETHING: npt.NDArray[np.uint8] = np.zeros((1, 1), np.uint8)


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
    recognizer = _Rerun(drive, reference_map, rows, config)
    for stamp_ns, readable in zip(drive.stamps_ns, drive.readable, strict=True):
        yield recognizer.process(Frame(stamp_ns, _SOMETHING if readable else None))


class _Remembered:
    """A matcher that looks scores up; a query is the index of its frame."""

    def __init__(self, rows: npt.NDArray[np.float32]) -> None:
        self._rows = rows

    def scores(self, query: int, indices: npt.NDArray[np.int64]) -> npt.NDArray[np.float32]:
        return self._rows[query, indices]

    def shift(self, _query: int, _index: int) -> None:
        return None


class _Rerun(PlaceRecognizer):
    def __init__(
        self,
        drive: Drive,
        reference_map: ReferenceMap,
        rows: npt.NDArray[np.float32],
        config: Config,
    ) -> None:
        super().__init__(reference_map, config)
        self._matcher = _Remembered(rows)  # type: ignore[assignment]
        self._drive = drive

    def _look(self, frame: Frame) -> _Seen:
        index = self._frames - 1
        descriptor = self._drive.descriptors[index]
        if frame.gray is None or not descriptor.informative:
            return _Seen(descriptor)
        row = np.full(len(self.reference_map), np.nan, np.float32)
        first_sight = self._shortlist.row(descriptor) if self._shortlist else None
        return _Seen(descriptor, index, row, first_sight)
