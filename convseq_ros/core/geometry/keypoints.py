# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Keypoints of two images and which of them are the same: SIFT, and MAGSAC for what is not."""

from dataclasses import dataclass
from typing import Any

from convseq_ros.core.constants import constants
from convseq_ros.core.geometry.lens import Points
import cv2
import numpy as np
import numpy.typing as npt

_CV2: Any = cv2  # whose types lack SIFT
Pairs = npt.NDArray[np.int64]  # (m, 2), of a keypoint of the one image and its like in the other


@constants
class KEYPOINT:
    """Of keypoints; chosen on road_1, road_2 and drawn streets (docs/GEOMETRY.md)."""

    most: int = 800  # of an image
    contrast: float = 0.01  # of OpenCV's SIFT; its usual .04 leaves too few at 320 px
    ratio: float = 0.85  # of the best to the second best distance, at most
    error_px: float = 1.0  # off an epipolar line
    probability: float = 0.999  # of a sample without outliers; OpenCV's samples are always alike
    samples: int = 1000  # at most
    fewest: int = 8  # pairs that have an epipolar geometry


@dataclass(frozen=True, eq=False, slots=True)
class Keypoints:
    """What is found in an image; equal to itself only."""

    shares: Points  # (n, 2), across and down, of the image: in (0, 1)
    looks: npt.NDArray[np.float32]  # (n, 128)
    size_px: tuple[int, int]  # of the image, width and height


def keypoints(gray: npt.NDArray[np.uint8], seen: npt.NDArray[np.bool_]) -> Keypoints:
    """Return the keypoints of an image (H, W), where a mask of any size says that it is seen."""
    size = gray.shape[1], gray.shape[0]
    mask = None
    if not seen.all():
        mask = cv2.resize(seen.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
    sift = _CV2.SIFT_create(nfeatures=KEYPOINT.most, contrastThreshold=KEYPOINT.contrast)
    found, looks = sift.detectAndCompute(gray, mask)
    places = np.array([one.pt for one in found], np.float64).reshape(-1, 2)
    if looks is None:
        looks = np.zeros((0, 128), np.float32)
    return Keypoints((places + 0.5) / size, looks, size)


def alike(one: Keypoints, other: Keypoints) -> Pairs:
    """Return which keypoints look like each other, far more than like any third."""
    if min(len(one.looks), len(other.looks)) < 2:
        return np.zeros((0, 2), np.int64)
    # Of looks whose squares are known, distances are a product.
    squares = [(looks**2).sum(axis=1) for looks in (one.looks, other.looks)]
    far = squares[0][:, None] + squares[1] - 2 * (one.looks @ other.looks.T)
    rows = np.arange(len(far))
    best = far.argmin(axis=1)
    is_best = far.argmin(axis=0)[best] == rows
    two = np.partition(far, 1, axis=1)[:, :2].clip(0.0)
    kept = is_best & (two[:, 0] < KEYPOINT.ratio**2 * two[:, 1])
    return np.column_stack((rows[kept], best[kept]))


def of_one_scene(one: Points, other: Points) -> npt.NDArray[np.bool_]:
    """Return which of some pairs, in pixels without distortion, have one epipolar geometry."""
    none = np.zeros(len(one), np.bool_)
    if len(one) < KEYPOINT.fewest:
        return none
    how = cv2.USAC_MAGSAC, KEYPOINT.error_px, KEYPOINT.probability, KEYPOINT.samples
    try:
        _, agree = cv2.findFundamentalMat(one, other, *how)
    except cv2.error:  # of all samples none had a geometry
        return none
    return none if agree is None else agree.ravel() > 0
