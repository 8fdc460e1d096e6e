# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Keypoints of an image, and the inliers of two images for one camera motion."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

COUNT = 2000  # keypoints of an image at most, the strongest
FEWEST = 12  # matches, and inliers, below which the result is 0; as in DLoopDetector
_REPROJECTION_PX, _CONFIDENCE, _ITERATIONS = 2.0, 0.99, 500  # of RANSAC; as in DLoopDetector
_SMALLEST_PX = 32  # smallest image side for ORB
ROWS = 480  # smaller images are enlarged to so many: ORB leaves out 31 px at each border
_FAST_THRESHOLD = 7  # of ORB; ORB-SLAM's where the usual 20 finds too few
_RATIO = 0.6  # maximum of nearest to second nearest distance; as in DLoopDetector

Rows = npt.NDArray[np.uint8] | npt.NDArray[np.float32]
Nodes = npt.NDArray[np.int32]


@dataclass(frozen=True, eq=False, slots=True)
class LocalFeatures:
    """Keypoints of one image."""

    points_px: npt.NDArray[np.float32]  # (n, 2), columns and rows
    descriptors: Rows  # (n, 32), 256 bits of ORB; or (n, 128), RootSIFT of unit length
    nodes: Nodes | None = None  # (n,), direct index; None: all may match

    @property
    def size_bytes(self) -> int:
        """Storage for verification; RootSIFT counts with 1 byte per number."""
        nodes_bytes = 0 if self.nodes is None else self.nodes.nbytes
        return self.points_px.nbytes + self.descriptors.size + nodes_bytes


Extract = Callable[..., LocalFeatures]  # of an image, and the `rows` that it is enlarged to


def orb(gray: npt.NDArray[np.uint8], rows: int = ROWS) -> LocalFeatures:
    """Return the ORB keypoints (Rublee et al. 2011) of a grey image (H, W), enlarged to `rows`."""
    if min(gray.shape) < _SMALLEST_PX:
        return _keypoints((), np.zeros((0, 32), np.uint8))
    detector = cv2.ORB.create(COUNT, fastThreshold=_FAST_THRESHOLD)
    points, bits = detector.detectAndCompute(_enlarged(gray, rows), None)
    return _keypoints(points, np.zeros((0, 32), np.uint8) if bits is None else bits)


def root_sift(gray: npt.NDArray[np.uint8], rows: int = ROWS) -> LocalFeatures:
    """
    Return SIFT (Lowe 2004) as RootSIFT (Arandjelovic and Zisserman 2012) of an image (H, W).

    The image is enlarged to `rows`.
    """
    points, found = cv2.SIFT.create(COUNT).detectAndCompute(_enlarged(gray, rows), None)
    found = np.zeros((0, 128), np.float32) if found is None else found
    shares = found / np.maximum(found.sum(axis=1, keepdims=True), np.finfo(np.float32).tiny)
    return _keypoints(points, np.sqrt(shares, dtype=np.float32))


def _enlarged(gray: npt.NDArray[np.uint8], least: int) -> npt.NDArray[np.uint8]:
    """Return an image with at least so many rows, in which keypoints are found, too."""
    rows, columns = gray.shape
    if not _SMALLEST_PX <= rows < least:
        return gray
    size = round(columns * least / rows), least
    return np.asarray(cv2.resize(gray, size, interpolation=cv2.INTER_CUBIC), np.uint8)


def inliers(query: LocalFeatures, reference: LocalFeatures) -> int:
    """Return the number of inliers of the best fundamental matrix; 0 if fewer than 12."""
    if min(len(query.points_px), len(reference.points_px)) < FEWEST:
        return 0
    rows = query.descriptors, reference.descriptors
    if query.nodes is None or reference.nodes is None:
        pairs = mutual_matches(*rows)
    else:
        pairs = indexed_matches(*rows, query.nodes, reference.nodes)
    if len(pairs) < FEWEST:
        return 0
    first, second = query.points_px[pairs[:, 0]], reference.points_px[pairs[:, 1]]
    ransac = cv2.FM_RANSAC, _REPROJECTION_PX, _CONFIDENCE, _ITERATIONS
    _, kept = cv2.findFundamentalMat(first, second, *ransac)
    count = 0 if kept is None else int(np.count_nonzero(kept))
    return count if count >= FEWEST else 0


def mutual_matches(query: Rows, reference: Rows) -> npt.NDArray[np.int64]:
    """Return index pairs (m, 2) of mutual nearest neighbours that pass Lowe's ratio test."""
    norm = cv2.NORM_HAMMING if query.dtype == np.uint8 else cv2.NORM_L2
    matcher = cv2.BFMatcher(norm)
    nearest = {pair.queryIdx: pair.trainIdx for pair in matcher.match(reference, query)}
    pairs = [
        (best.queryIdx, best.trainIdx)
        for best, *others in matcher.knnMatch(query, reference, k=2)
        if nearest.get(best.trainIdx) == best.queryIdx
        and (not others or best.distance < _RATIO * others[0].distance)
    ]
    return np.array(pairs, np.int64).reshape(-1, 2)


def indexed_matches(
    query: Rows, reference: Rows, query_nodes: Nodes, reference_nodes: Nodes
) -> npt.NDArray[np.int64]:
    """Return the mutual matches within each node of the direct index, as index pairs (m, 2)."""
    pairs = [np.zeros((0, 2), np.int64)]
    for node in np.intersect1d(query_nodes, reference_nodes):
        ours, theirs = np.flatnonzero(query_nodes == node), np.flatnonzero(reference_nodes == node)
        found = mutual_matches(query[ours], reference[theirs])
        pairs.append(np.stack((ours[found[:, 0]], theirs[found[:, 1]]), axis=1))
    return np.concatenate(pairs)


def _keypoints(points: Sequence[cv2.KeyPoint], rows: Rows) -> LocalFeatures:
    return LocalFeatures(np.array([point.pt for point in points], np.float32).reshape(-1, 2), rows)
