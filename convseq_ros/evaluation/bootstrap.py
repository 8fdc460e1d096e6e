# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How sure a figure is, when neighbouring frames are not independent."""

from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt

Figures = Mapping[str, float | None]
_RESAMPLES = 1000
_SEED = 0


def block_intervals(
    count: int,
    figures: Callable[[npt.NDArray[np.int64]], Figures],
    block: int | None = None,
    level: float = 0.95,
) -> dict[str, tuple[float, float]]:
    """
    Return confidence intervals from resampled contiguous blocks of the sequence.

    Parameters
    ----------
    count : int
        Frames in the sequence.
    figures : callable
        Figures of a resampled sequence by name, given the indices of its frames; None for one that
        it does not have.
    block : int, optional
        Frames in a block; by default the square root of `count`.
    level : float
        Share of the resampled figures inside the interval.

    Returns
    -------
    dict of str to tuple of 2 floats
        Percentile intervals, the same at every call; figures that never exist are left out.

    Notes
    -----
    The circular block bootstrap (Politis and Romano 1992): blocks may start at every frame and
    run on from the end to the start, so every frame is drawn equally often.

    """
    if not count:
        return {}
    block = min(block or max(1, round(count**0.5)), count)
    generator = np.random.default_rng(_SEED)
    starts = generator.integers(0, count, (_RESAMPLES, -(-count // block)))
    chosen = (starts[:, :, None] + np.arange(block)).reshape(_RESAMPLES, -1)[:, :count] % count
    drawn = [figures(one) for one in chosen]
    tail = (1 - level) / 2
    intervals = {}
    for name in drawn[0]:
        values = [one[name] for one in drawn if one[name] is not None]
        if values:
            low, high = np.quantile(np.array(values, np.float64), (tail, 1 - tail))
            intervals[name] = (float(low), float(high))
    return intervals
