# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which references are right for which query, whatever the form in which a data set says it."""

from dataclasses import dataclass

from convseq_ros.errors import SourceError
import numpy as np
import numpy.typing as npt

SLIP_FRAMES = 3


@dataclass(frozen=True, slots=True)
class Truth:
    """The right answers."""

    right: npt.NDArray[np.bool_]  # (Q, R); a row without any is a place that the map lacks
    tolerance: int = 0  # frames by which an answer may be off, already part of `right`

    @property
    def known(self) -> npt.NDArray[np.bool_]:
        """Which queries have a right reference, shape (Q,)."""
        return np.asarray(self.right.any(axis=1))

    @property
    def slip(self) -> npt.NDArray[np.bool_]:
        """Which references lie up to 3 frames beyond the tolerance, shape (Q, R)."""
        return _widened(self.right, SLIP_FRAMES) & ~self.right

    def __post_init__(self) -> None:
        if self.right.ndim != 2 or self.right.dtype != np.bool_:
            raise ValueError(f'expected (Q, R) bool, got {self.right.shape} {self.right.dtype}')


def same_index(queries: int, references: int, tolerance: int) -> Truth:
    """Return the truth of drives with one place an index; SourceError if their lengths differ."""
    if queries != references:
        raise SourceError(
            f'truth: identity needs drives of one length, got {queries} query and {references} '
            'reference images; give a table or complete the folders'
        )
    return Truth(_widened(np.eye(queries, dtype=np.bool_), tolerance), tolerance)


def listed(
    pairs: npt.NDArray[np.int64], shape: tuple[int, int], tolerance: int, where: str
) -> Truth:
    """Return the truth of pairs (P, 2), or (P, 3) with tolerances; SourceError for no frame."""
    right = np.zeros(shape, np.bool_)
    for query, reference, *own in pairs.tolist():
        for kind, index, count in (('query', query, shape[0]), ('reference', reference, shape[1])):
            if not 0 <= index < count:
                raise SourceError(
                    f'{where}: {kind} {index} does not exist, there are {count} (0 to '
                    f'{count - 1}); complete the images or correct the truth'
                )
        reach = own[0] if own else tolerance
        right[query, max(0, reference - reach) : reference + reach + 1] = True
    return Truth(right, tolerance)


def within_radius(
    queries: npt.NDArray[np.float64], references: npt.NDArray[np.float64], radius_m: float
) -> Truth:
    """Return the truth of positions (Q, 3) and (R, 3), metres; NaN, for none, is never right."""
    distance = np.linalg.norm(queries[:, None] - references[None], axis=2)
    return Truth(distance <= radius_m)


def of_the_past(truth: Truth, exclude_recent: int) -> Truth:
    """Return the truth of a drive against its own past, the latest frames left out."""
    index = np.arange(len(truth.right))
    return Truth(
        truth.right & (index[None] <= index[:, None] - max(1, exclude_recent)), truth.tolerance
    )


def _widened(right: npt.NDArray[np.bool_], frames: int) -> npt.NDArray[np.bool_]:
    wide = right.copy()
    for offset in range(1, min(frames, right.shape[1] - 1) + 1):
        wide[:, offset:] |= right[:, :-offset]
        wide[:, :-offset] |= right[:, offset:]
    return wide
