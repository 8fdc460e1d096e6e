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
    """
    The right answers.

    Parameters
    ----------
    right : ndarray of bool, shape (Q, R)
        Query by reference; a row without any is a place that the map does not hold.
    tolerance : int
        Frames by which a right answer may be off, already part of `right`.

    """

    right: npt.NDArray[np.bool_]
    tolerance: int = 0

    @property
    def known(self) -> npt.NDArray[np.bool_]:
        """Which queries have a right reference, shape (Q,)."""
        return np.asarray(self.right.any(axis=1))

    @property
    def slip(self) -> npt.NDArray[np.bool_]:
        """
        Which references are the right place but a little off, shape (Q, R).

        They lie up to 3 frames beyond the tolerance: at +-2, an answer that is off by 3 to 5.
        """
        return _widened(self.right, SLIP_FRAMES) & ~self.right

    def __post_init__(self) -> None:
        if self.right.ndim != 2 or self.right.dtype != np.bool_:
            raise ValueError(f'expected (Q, R) bool, got {self.right.shape} {self.right.dtype}')


def same_index(queries: int, references: int, tolerance: int) -> Truth:
    """
    Return the truth of two drives that show the same place at the same index.

    Raises
    ------
    SourceError
        If the drives differ in length.

    """
    if queries != references:
        raise SourceError(
            f'truth: identity needs drives of one length, got {queries} query and {references} '
            'reference images; give a table or complete the folders'
        )
    return Truth(_widened(np.eye(queries, dtype=np.bool_), tolerance), tolerance)


def listed(
    pairs: npt.NDArray[np.int64], shape: tuple[int, int], tolerance: int, where: str
) -> Truth:
    """
    Return the truth that a list of pairs states.

    Parameters
    ----------
    pairs : ndarray of int64, shape (P, 2) or (P, 3)
        Query, reference and, if there is a third column, the tolerance of this pair.
    shape : tuple of 2 ints
        Queries and references that there are.
    tolerance : int
        Of pairs without one of their own.
    where : str
        The file, for messages.

    Raises
    ------
    SourceError
        If a pair names a frame that does not exist.

    """
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
    """
    Return the truth that positions give.

    Parameters
    ----------
    queries, references : ndarray of float64, shape (Q, 3) and (R, 3)
        Positions in metres; NaN where there is none, which is never right.
    radius_m : float
        The largest distance of a right answer.

    """
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
