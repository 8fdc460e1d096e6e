# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The global descriptor: what an image looks like at a coarse glance, in half a kilobyte.

The projected regions form an image of 32 channels. Of its first 12 channels, the leading axes of
the projection, a cosine transform keeps the 21 lowest frequencies: what changes slowly over the
image is still there after a shift of a few cells, and an axis of little variance is mostly noise
at night. The reduction is fixed, so that maps can grow.
"""

from dataclasses import dataclass
from functools import cache
from math import isqrt

from convseq_ros.core.encoding.regions import Cells, projected_regions
import numpy as np
import numpy.typing as npt


@dataclass(frozen=True, slots=True)
class GlobalConstants:
    """Size of the descriptor; chosen by recall of the coarse search (docs/MATCHING.md)."""

    frequencies: int = 6  # down and across together; 21 pairs of them
    axes: int = 12  # channels, of 32


GLOBAL = GlobalConstants()


def global_descriptor(cells: Cells) -> npt.NDArray[np.float16]:
    """
    Return the low frequencies of the regions of cells (S, S, 8).

    Returns
    -------
    ndarray of float16, shape (252,), shorter for images below 128 px
        Not normalised.

    """
    regions = projected_regions(cells)
    side = isqrt(len(regions))
    waves = _waves(side)
    rows = waves @ regions[:, : GLOBAL.axes].reshape(side, -1)
    spectrum = waves @ rows.reshape(len(waves), side, GLOBAL.axes)
    order = np.arange(len(waves))
    low = np.add.outer(order, order) < GLOBAL.frequencies
    return spectrum[low].ravel().astype(np.float16)


@cache
def global_descriptor_length(cell_shape: tuple[int, int, int]) -> int:
    """Return how many numbers there are for cells of a shape."""
    return len(global_descriptor(np.zeros(cell_shape, np.float32)))


@cache
def _waves(side: int) -> npt.NDArray[np.float32]:
    """Return the rows of a cosine transform, scaled to give means: (frequencies, side)."""
    frequency = np.arange(min(GLOBAL.frequencies, side))[:, None]
    phase = np.pi * frequency * (np.arange(side) + 0.5) / side
    scale = np.where(frequency, np.sqrt(2.0), 1.0) / side
    return np.asarray(scale * np.cos(phase), np.float32)
