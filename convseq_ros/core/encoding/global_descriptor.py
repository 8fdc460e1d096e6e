# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What an image looks like at first sight, in half a kilobyte.

The projected regions of coherent matching form an image of 32 channels. Its first 12 channels, the
leading axes of the projection, are transformed by a cosine transform, and only the 21 lowest
frequencies are kept: what changes slowly over the image is still there after a few cells of shift,
and what an axis of little variance says at night is mostly noise. The reduction is fixed, so that
maps can grow.
"""

from functools import cache
from math import isqrt

from convseq_ros.core.similarity.coherent import projected_regions
import numpy as np
import numpy.typing as npt

_FREQUENCIES = 6
_AXES = 12


def pooled(cells: npt.NDArray[np.float32]) -> npt.NDArray[np.float16]:
    """
    Return the low frequencies of an image's projected regions.

    Parameters
    ----------
    cells : ndarray of float32, shape (S, S, 8)
        Cell histograms.

    Returns
    -------
    ndarray of float16, shape (252,), shorter for images below 128 px
        Not normalised.

    """
    regions = projected_regions(cells)
    side = isqrt(len(regions))
    waves = _waves(side)
    rows = waves @ regions[:, :_AXES].reshape(side, -1)
    frequencies = waves @ rows.reshape(len(waves), side, _AXES)
    return frequencies[_kept(len(waves))].ravel().astype(np.float16)


@cache
def pooled_length(cell_shape: tuple[int, int, int]) -> int:
    """Return how many numbers there are for cells of a shape."""
    return len(pooled(np.zeros(cell_shape, np.float32)))


@cache
def _waves(side: int) -> npt.NDArray[np.float32]:
    """Return the rows of a cosine transform, scaled to give means: (frequencies, side)."""
    frequency = np.arange(min(_FREQUENCIES, side))[:, None]
    phase = np.pi * frequency * (np.arange(side) + 0.5) / side
    scale = np.where(frequency, np.sqrt(2.0), 1.0) / side
    return np.asarray(scale * np.cos(phase), np.float32)


def _kept(count: int) -> npt.NDArray[np.bool_]:
    """Return which pairs of frequencies down and across are low together."""
    return np.add.outer(np.arange(count), np.arange(count)) < _FREQUENCIES
