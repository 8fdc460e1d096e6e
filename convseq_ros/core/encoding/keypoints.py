# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The keypoints of an image: ORB on a copy whose longer side is 320 px.

Cells cannot tell two alike aisles apart; keypoints can, in like light. Stored, a keypoint has 34
bytes: its position in 256ths of the image, across and down, and the 32 bytes of its descriptor.

Sources: Rublee et al. 2011 (ORB).
"""

from dataclasses import dataclass
import math

from convseq_ros.core.types import constants, Doubles, Flags, Floats, Gray, Shift
import cv2
import numpy as np
import numpy.typing as npt

StoredKeypoints = npt.NDArray[np.uint8]  # (n, 34): x, y, descriptor

BYTES = 34  # of a stored keypoint
NONE: StoredKeypoints = np.zeros((0, BYTES), np.uint8)
_SHARES = 256  # steps of a stored position


@constants
class ORB:
    """ORB and its matches; on corridor, 300 in 4 octaves separate as 500 in 8 do (NOTES.md)."""

    longer_px: int = 320  # of the copy; smaller images are enlarged
    octaves: int = 4
    fast_threshold: int = 7  # levels; the default of 20 finds few corners in the dark
    edge_px: int = 15  # border without keypoints; the default of 31 leaves few on small images
    ratio: float = 0.9  # largest ratio of the best to the second best distance
    tolerance_cells: float = 2.0  # from the motion of the cells: 20 px of the copy
    blocks: int = 16  # rows and columns of blocks in which agreeing keypoints are counted


@dataclass(frozen=True, eq=False, slots=True)
class Keypoints:
    """The keypoints of an image; equal to itself only."""

    shares: Doubles  # (n, 2), across and down, as shares of the image: in (0, 1)
    bits: Floats  # (n, 256), the bits of the descriptors as -1 and 1

    @classmethod
    def of_stored(cls, stored: StoredKeypoints) -> 'Keypoints':
        """Return stored keypoints (n, 34)."""
        bits = np.unpackbits(np.ascontiguousarray(stored[:, 2:]), axis=1)
        return cls((stored[:, :2] + 0.5) / _SHARES, bits.astype(np.float32) * 2 - 1)


def detect(gray: Gray, visible: Flags, most: int) -> StoredKeypoints:
    """Return the `most` strongest keypoints of an image (H, W) in its `visible` cells (S, S)."""
    scale = ORB.longer_px / max(gray.shape)
    size = max(1, round(gray.shape[1] * scale)), max(1, round(gray.shape[0] * scale))
    if min(size) <= 2 * ORB.edge_px or not most:
        return NONE
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    copy = gray if scale == 1 else cv2.resize(gray, size, interpolation=how)
    mask = None
    if not visible.all():
        mask = cv2.resize(visible.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
    detector = cv2.ORB_create(  # type: ignore[attr-defined]
        nfeatures=most,
        nlevels=ORB.octaves,
        edgeThreshold=ORB.edge_px,
        fastThreshold=ORB.fast_threshold,
    )
    found, descriptors = detector.detectAndCompute(copy, mask)
    if descriptors is None:
        return NONE
    positions = np.array([keypoint.pt for keypoint in found]).reshape(-1, 2)
    steps = ((positions + 0.5) / size * _SHARES).clip(0, _SHARES - 1).astype(np.uint8)
    return np.hstack((steps, descriptors))[:most]


def matched(query: Keypoints, place: Keypoints) -> Doubles:
    """
    Return mutual best matches of two images that pass the ratio test, (n, 4).

    Columns: across and down in the query, then in the place, as shares of the image.
    """
    if min(len(query.bits), len(place.bits)) < 2:
        return np.zeros((0, 4))
    products = query.bits @ place.bits.T  # 256 less twice the Hamming distance
    best = products.argmax(axis=1)
    mutual = np.flatnonzero(products.argmax(axis=0)[best] == np.arange(len(best)))
    found, others = products[mutual, best[mutual]], products[mutual]
    others[np.arange(len(mutual)), best[mutual]] = -np.inf
    bits = query.bits.shape[1]
    clear = bits - found < ORB.ratio * (bits - others.max(axis=1))
    here = mutual[clear]
    return np.hstack((query.shares[here], place.shares[best[here]]))


def common_shift(matches: Doubles, side: int) -> Shift:
    """
    Return the shift that most of the matches (n, 4) share, rows and columns in cells.

    It is the median of those within twice the tolerance of the match that most others are near.
    """
    moved = _moved(matches, side)
    apart = np.hypot(*(moved[:, None] - moved).transpose(2, 0, 1))
    is_near = apart < 2 * ORB.tolerance_cells
    row, column = np.median(moved[is_near[is_near.sum(axis=1).argmax()]], axis=0)
    return float(row), float(column)


def agreeing(matches: Doubles, motion: Doubles, side: int) -> Doubles:
    """
    Return those of the matches (n, 4) that moved as the cells did.

    `motion` (2, 3) is that of `verification.motion`, of images of `side` x `side` regions.
    """
    cells = side + 2  # a region is three cells wide
    across, down = ((matches[:, :2] - 0.5) * cells / side).T
    expected = np.column_stack((np.ones(len(matches)), down, across)) @ motion.T
    off = _moved(matches, side) - expected
    return matches[np.hypot(off[:, 0], off[:, 1]) < ORB.tolerance_cells]


def agreeing_by_chance(count: int, side: int) -> float:
    """Return how many of `count` matches that moved anywhere in the image agree with a motion."""
    return count * math.pi * (ORB.tolerance_cells / (side + 2)) ** 2


def agreeing_blocks(matches: Doubles, motion: Doubles, side: int) -> int:
    """
    Return in how many of 16 x 16 blocks of a query there is one of the `agreeing` matches.

    Blocks are counted, not keypoints, so that a single object does not count like a scene.
    """
    here = agreeing(matches, motion, side)[:, :2]
    blocks = (here * ORB.blocks).astype(np.int64)
    return len(np.unique(blocks @ (ORB.blocks, 1)))


def _moved(matches: Doubles, side: int) -> Doubles:
    """Return by how many rows and columns of cells matches moved, (n, 2)."""
    return (matches[:, 2:] - matches[:, :2])[:, ::-1] * (side + 2)
