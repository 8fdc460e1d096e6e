# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A tree of all descriptors of a map: HBST (Schlegel and Grisetti, RA-L 2018), by `pyhbst`."""

from convseq_ros.baselines.local_features import LocalFeatures
import numpy as np
import numpy.typing as npt

_DISTANCE = 25  # of 256 bits; descriptors less apart match, as its authors have it
_NO_IMAGE = 2**63  # number of a query, which the library wants and does not use


class HammingTree:
    """The tree; it grows by an image at a time."""

    def __init__(self) -> None:
        import pyhbst

        self._tree, self._even = pyhbst.BinarySearchTree256(), pyhbst.SplittingStrategy.SplitEven
        self._images = 0

    def __len__(self) -> int:
        return self._images

    def add(self, keypoints: LocalFeatures) -> None:
        """Add an image of ORB keypoints; its number is the number of images before."""
        if len(keypoints.points_px):
            self._tree.add(*_lists(keypoints), self._images, self._even)
        self._images += 1

    def shares(self, keypoints: LocalFeatures) -> npt.NDArray[np.float32]:
        """Return the share of the descriptors that each image of the tree matches, (R,)."""
        shares = np.zeros(self._images, np.float32)
        if len(keypoints.points_px):
            asked = *_lists(keypoints), _NO_IMAGE, False, _DISTANCE
            for score in self._tree.getScorePerImage(*asked):
                shares[score.identifier_reference] = score.matching_ratio
        return shares


def _lists(keypoints: LocalFeatures) -> tuple[list[list[float]], list[list[bool]]]:
    """Return points and bits as the library wants them."""
    bits = np.unpackbits(np.asarray(keypoints.descriptors, np.uint8), axis=1).astype(bool)
    return keypoints.points_px.tolist(), bits.tolist()
