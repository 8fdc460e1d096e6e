# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where regions lie in another image, searched for about where each is expected."""

from convseq_ros.core.compiled import kernels_of
from convseq_ros.core.geometry.displacement import Arranged, arranged
from convseq_ros.core.geometry.lens import Points
import cv2
import numpy as np
import numpy.typing as npt


def followed(regions: Arranged, other: Arranged, went: Points) -> Points:
    """
    Return where regions lie in another image, rows and columns (n, 2); NaN if not found.

    They are expected to have moved by `went` rows and columns, (n, 2). The other image is
    bent until all would stay where they are: then no region leaves the search, however far it
    moved, and neighbours, over which similarities are averaged, move alike. Ours: the
    averaged field alone makes large parallax too small.
    """
    side = regions.side
    grid = np.indices((side, side)).reshape(2, -1).T.astype(np.float64)
    expected = _image(grid + went, side)
    bent = cv2.remap(
        _image(other.regions, side), expected[..., 1], expected[..., 0], cv2.INTER_LINEAR
    )
    kernels = kernels_of('convseq_ros.core.geometry')
    found = kernels.displacements(regions, arranged(bent.reshape(side**2, -1)), (0, 0))
    places = np.full((side**2, 2), np.nan)
    if len(found):
        at = found[:, :2] + found[:, 2:4]
        edge = cv2.BORDER_REPLICATE
        moved = cv2.remap(
            _image(went, side), at[:, 1], at[:, 0], cv2.INTER_LINEAR, borderMode=edge
        )
        places[(found[:, 0] * side + found[:, 1]).astype(int)] = at + moved.reshape(-1, 2)
    places[((places < -0.5) | (places > side - 0.5)).any(axis=1)] = np.nan
    return places


def _image(numbers: npt.NDArray[np.floating], side: int) -> npt.NDArray[np.float32]:
    return np.ascontiguousarray(numbers, np.float32).reshape(side, side, -1)
