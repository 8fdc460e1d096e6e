# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""SeqSLAM (Milford and Wyeth, ICRA 2012), sequence matching without training."""

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float32]
LENGTH = 10
_WIDTH_PX, _HEIGHT_PX, _PATCH_PX = 64, 32, 8
_CONTRAST_WINDOW = 10
_VELOCITIES = (0.8, 0.9, 1.0, 1.1, 1.2)


def patch_normalized(gray: npt.NDArray[np.uint8]) -> Floats:
    """
    Return a small copy of a grey image whose patches have mean 0 and deviation 1, (2048,).

    The widespread Python port keeps these values as unsigned bytes, where negative differences
    wrap round; here they are signed.
    """
    small = cv2.resize(gray, (_WIDTH_PX, _HEIGHT_PX), interpolation=cv2.INTER_AREA)
    patches = small.astype(np.float32).reshape(
        _HEIGHT_PX // _PATCH_PX, _PATCH_PX, _WIDTH_PX // _PATCH_PX, _PATCH_PX
    )
    mean = patches.mean(axis=(1, 3), keepdims=True)
    deviation = patches.std(axis=(1, 3), keepdims=True)
    normal = np.divide(patches - mean, deviation, out=np.zeros_like(patches), where=deviation > 0)
    return normal.ravel()


def differences(queries: Floats, references: Floats) -> Floats:
    """Return the mean absolute difference of every query (Q, P) and reference (R, P): (Q, R)."""
    return np.stack([np.abs(references - query).mean(axis=1) for query in queries])


def enhanced(difference: Floats, window: int = _CONTRAST_WINDOW) -> Floats:
    """Return for each difference (Q, R) how many deviations it is below its neighbours' mean."""
    reach = window // 2
    count = difference.shape[1]
    index = np.arange(count)
    first = np.maximum(index - reach, 0)
    last = np.minimum(index + reach + 1, count)
    number = last - first
    sums, squares = (
        np.pad(np.cumsum(part.astype(np.float64), axis=1), ((0, 0), (1, 0)))
        for part in (difference, difference.astype(np.float64) ** 2)
    )
    mean = (sums[:, last] - sums[:, first]) / number
    variance = (squares[:, last] - squares[:, first]) / number - mean**2
    deviation = np.sqrt(np.maximum(variance, 0))
    similarity = np.divide(
        mean - difference, deviation, out=np.zeros_like(mean), where=deviation > 1e-9
    )
    return similarity.astype(np.float32)


def trajectory_scores(rows: Sequence[Floats | None]) -> npt.NDArray[np.float64]:
    """
    Return the mean similarity along the best straight line that ends at each reference, (R,).

    `rows` are k similarities (R,), newest first; None counts as 0. Lines have 0.8 to 1.2
    references per frame. They end at the newest frame, as in the paper; its code centres them.
    """
    count = next(len(row) for row in rows if row is not None)
    ages = np.arange(len(rows))
    table = np.stack([np.zeros(count) if row is None else row for row in rows])
    best = np.full(count, -np.inf)
    for velocity in _VELOCITIES:
        back = np.round(ages * velocity).astype(np.int64)
        ends = np.arange(back[-1], count)
        if len(ends):
            mean = table[ages, ends[:, None] - back].mean(axis=1)
            best[ends] = np.maximum(best[ends], mean)
    return best
