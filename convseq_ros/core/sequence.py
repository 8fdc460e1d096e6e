# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How many frames are matched together, and how well they match (paper III-A, E, F, G)."""

from collections.abc import Callable, Sequence

from convseq_ros.config import SequenceConfig
from convseq_ros.core.types import Descriptor
import numpy as np
import numpy.typing as npt

Row = npt.NDArray[np.float32]

BACKWARD = -1
FORWARD = 1


def choose_length(
    outward: Sequence[Descriptor],
    similarity: Callable[[Descriptor, Descriptor], float],
    config: SequenceConfig,
) -> int | None:
    """
    Return the length k of the sequence that starts at an anchor frame.

    The sequence grows while its outermost frame still overlaps the anchor (little information
    gain), then while it holds too little entropy.

    Parameters
    ----------
    outward : sequence of Descriptor
        The frames in order outward from the anchor, which is the first and informative.
    similarity : callable
        Pair score of two descriptors, in [0, 1].
    config : SequenceConfig
        Thresholds and bounds.

    Returns
    -------
    int or None
        None if more frames than given would be needed.

    Notes
    -----
    With the following departures from the paper: (1) information gain is read as the released
    script does, `similarity >= overlap_threshold` extends; (2) the shortest chosen length is 2;
    (3) online, the anchor is the newest frame and the sequence reads into the past (the paper's
    anchor is the oldest frame and needs up to 24 future ones); (4) uninformative frames are passed
    over.

    """
    available = len(outward)
    if config.fixed_length:
        return config.fixed_length if config.fixed_length <= available else None

    def overlaps(other: Descriptor) -> bool:
        return (
            not other.informative or similarity(outward[0], other) >= config.overlap_threshold
        )

    length = config.min_length
    while length < config.max_overlap_length and length <= available:
        if not overlaps(outward[length - 1]):
            break
        length += 1
    while length < config.max_length and length <= available:
        if mean_entropy(outward[:length]) > config.entropy_threshold:
            break
        length += 1
    return length if length <= available else None


def mean_entropy(frames: Sequence[Descriptor]) -> float:
    """Return the mean entropy of the informative ones among at least one such frame."""
    return float(np.mean([frame.entropy for frame in frames if frame.informative]))


def sequence_scores(
    rows: Sequence[Row | None], direction: int = BACKWARD, slope: float = 1.0
) -> npt.NDArray[np.float64]:
    """
    Return how well a sequence of frames matches each reference, in order.

    Parameters
    ----------
    rows : sequence of k ndarrays of float32, shape (R,), or None
        Pair scores of the frames in order outward from the anchor, NaN where there is none; None
        for an uninformative frame. The anchor has a row.
    direction : BACKWARD or FORWARD
        Whether the frames lie before or after the anchor.
    slope : float
        References that pass while one frame does; 1, one to one, in the paper.

    Returns
    -------
    ndarray of float64, shape (R,)
        At each reference, the mean of the pair scores along the diagonal that ends (BACKWARD) or
        starts (FORWARD) there. -inf where the window leaves the map, the reference itself has no
        score, or less than half of the window's pairs have one.

    """
    anchor_row = rows[0]
    if anchor_row is None:
        raise ValueError('the anchor of a sequence must be informative')
    count, length = len(anchor_row), len(rows)
    total, pairs = np.zeros(count), np.zeros(count)
    steps = diagonal(length, slope)
    for step, row in zip(steps, rows, strict=True):
        if row is None or step >= count:
            continue
        near, far = slice(step, None), slice(None, count - step)
        anchor, other = (near, far) if direction == BACKWARD else (far, near)
        known = np.isfinite(row[other])
        total[anchor] += np.where(known, row[other], 0)
        pairs[anchor] += known
    index = np.arange(count) if direction == BACKWARD else np.arange(count)[::-1]
    scored = np.isfinite(anchor_row) & (index >= steps[-1]) & (2 * pairs >= length)
    return np.divide(total, pairs, out=np.full(count, -np.inf), where=scored)


def diagonal(length: int, slope: float = 1.0) -> list[int]:
    """Return how many references before its end a diagonal meets each frame, newest first."""
    return [int(offset * slope + 0.5) for offset in range(length)]
