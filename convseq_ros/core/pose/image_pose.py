# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The pose of a lens relative to a place whose image the map keeps: keypoints, far finer than cells.

Keypoints of the place get their depth from neighbours of the same drive that have images, too. By
night few keypoints are detected, or none agree: then the result is None.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from typing import Any

from convseq_ros.core.encoding.descriptor import visible_cells
from convseq_ros.core.geometry.alignment import (
    align,
    ALIGNMENT,
    Alignment,
    Precision,
    start_by_points,
)
from convseq_ros.core.geometry.lens import Points, rays_through
from convseq_ros.core.geometry.structure import Sight, Structure, triangulate
from convseq_ros.core.map.image_coding import reduced
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.pose.estimate import MapMotion
from convseq_ros.core.rigid import inverse, Matrix, matrix, ROBOT_LENS
from convseq_ros.core.types import Camera, constants, Doubles, Flags, Floats, Frame, Gray, Indices
import cv2
import numpy as np

_CV2: Any = cv2  # OpenCV's type stubs lack SIFT
Pairs = Indices  # (m, 2), a keypoint of the first image and its match in the second
_KEPT = 64  # places whose keypoints and depths are cached; 30 MB at most


@constants
class KEYPOINT:
    """Keypoints and matches; tuned on road_1, road_2 and drawn streets (docs/GEOMETRY.md)."""

    most: int = 800  # keypoints of an image
    contrast: float = 0.01  # threshold of OpenCV's SIFT; its default .04 leaves too few at 320 px
    ratio: float = 0.85  # largest ratio of the best to the second best distance
    error_px: float = 1.0  # distance from an epipolar line
    unit_px: float = 2.0  # unit of errors, in pixels of a kept image; for regions it is the cell


@dataclass(frozen=True, eq=False, slots=True)
class SiftKeypoints:
    """The keypoints of an image; equal to itself only."""

    shares: Points  # (n, 2), across and down, as shares of the image: in (0, 1)
    descriptors: Floats  # (n, 128)
    size_px: tuple[int, int]  # of the image, width and height


def keypoints(gray: Gray, visible: Flags) -> SiftKeypoints:
    """Return the keypoints of an image (H, W) in the part that `visible`, of any size, shows."""
    size = gray.shape[1], gray.shape[0]
    mask = None
    if not visible.all():
        mask = cv2.resize(visible.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
    sift = _CV2.SIFT_create(nfeatures=KEYPOINT.most, contrastThreshold=KEYPOINT.contrast)
    detected, descriptors = sift.detectAndCompute(gray, mask)
    positions = np.array([keypoint.pt for keypoint in detected], np.float64).reshape(-1, 2)
    if descriptors is None:
        descriptors = np.zeros((0, 128), np.float32)
    return SiftKeypoints((positions + 0.5) / size, descriptors, size)


def matched_keypoints(first: SiftKeypoints, second: SiftKeypoints) -> Pairs:
    """Return mutual best matches of two images that pass the ratio test."""
    if min(len(first.descriptors), len(second.descriptors)) < 2:
        return np.zeros((0, 2), np.int64)
    squares = [(image.descriptors**2).sum(axis=1) for image in (first, second)]
    distances = squares[0][:, None] + squares[1] - 2 * (first.descriptors @ second.descriptors.T)
    rows = np.arange(len(distances))
    best = distances.argmin(axis=1)
    is_mutual = distances.argmin(axis=0)[best] == rows
    two = np.partition(distances, 1, axis=1)[:, :2].clip(0.0)
    kept = is_mutual & (two[:, 0] < KEYPOINT.ratio**2 * two[:, 1])
    return np.column_stack((rows[kept], best[kept]))


def epipolar_inliers(first: Points, second: Points) -> Flags:
    """Return which pairs (n, 2), in pixels without distortion, agree with an epipolar geometry."""
    none = np.zeros(len(first), np.bool_)
    if len(first) < ALIGNMENT.fewest_points:
        return none
    options = cv2.USAC_MAGSAC, KEYPOINT.error_px, ALIGNMENT.probability
    try:
        _, agree = cv2.findFundamentalMat(first, second, *options)
    except cv2.error:  # no sample has a geometry
        return none
    return none if agree is None else agree.ravel() > 0


@dataclass(frozen=True, eq=False)
class LensView:
    """An image by the camera that took it."""

    camera: Camera

    @property
    def base_lens(self) -> Matrix:
        """The pose of the lens in the base, (4, 4); by default it looks along x."""
        return matrix(self.camera.mount) @ ROBOT_LENS if self.camera.mount else ROBOT_LENS


@dataclass(frozen=True, eq=False)
class KeypointView(LensView):
    """An image by its keypoints."""

    keypoints: SiftKeypoints

    @property
    def scale(self) -> Doubles:
        """Units (`KEYPOINT.unit_px`) across and down per length of 1 in the plane z = 1."""
        width, height = self.keypoints.size_px
        camera = self.camera
        across, down = width / camera.width_px, height / camera.height_px
        return np.array((camera.fx_px * across, camera.fy_px * down)) / KEYPOINT.unit_px

    @cached_property
    def rays(self) -> Doubles:
        """Rays of the keypoints, (n, 3), with z = 1; NaN where unknown."""
        flat = rays_through(self.camera, self.keypoints.shares)
        return np.column_stack((flat, np.ones(len(flat))))

    def sight(self, other: 'KeypointView', moved: Matrix) -> Sight:
        """Return where another view, moved by (4, 4) from this lens, sees these keypoints."""
        here, there = matched_keypoints(self.keypoints, other.keypoints).T
        observed = np.full((len(self.rays), 2), np.nan)
        observed[here] = other.rays[there, :2]
        return Sight(observed, moved, other.scale)

    def sight_of_scene(self, other: 'KeypointView', moved: Matrix) -> Sight:
        """Return `sight` without epipolar outliers; `moved` is a guess."""
        sight = self.sight(other, moved)
        plane, observed = self.rays[:, :2], sight.observed
        known = np.flatnonzero(np.isfinite(observed).all(axis=1) & np.isfinite(plane).all(axis=1))
        units = (plane[known] * self.scale, observed[known] * other.scale)
        agree = epipolar_inliers(*(points * KEYPOINT.unit_px for points in units))
        observed[np.setdiff1d(np.arange(len(observed)), known[agree])] = np.nan
        return sight


# In units of `KEYPOINT.unit_px`. The first sigmas are wide, as the guess is only as good as cells.
PRECISION = Precision(
    sigmas=(8.0, 4.0, 2.0, 1.0, 1.0, 0.3, 0.3, 0.3, 0.3, 0.3, 0.3),
    agreeing=0.8,
    fewest=15,
    least_share=0.8,
)


@dataclass(frozen=True, eq=False, slots=True)
class _Place:
    """A place of the map with depths from its neighbours."""

    view: KeypointView
    structure: Structure
    neighbours: Doubles  # (k, 3), their positions from the place's lens


class ImagePoses:
    """Aligns queries with the kept images of a map, each of at most `max_mpx` megapixels."""

    def __init__(self, reference_map: ReferenceMap, motion: MapMotion, max_mpx: float) -> None:
        self._motion = motion
        self._visible = visible = visible_cells(
            reference_map.encoding.image_mask, reference_map.cell_shape[0]
        )

        @lru_cache(_KEPT)
        def view_of(index: int, camera: Camera) -> KeypointView | None:
            gray = reference_map.image(index, max_mpx)
            return None if gray is None else KeypointView(camera, keypoints(gray, visible))

        self._place = lru_cache(_KEPT)(partial(_place, motion, view_of))

    def align(self, index: int, own: Camera, frame: Frame, moved: Matrix) -> Alignment | None:
        """
        Return the alignment of a frame with a place; None if too few keypoints agree.

        `own` is the place's camera. `moved` (4, 4) is a guess of the motion from its lens to the
        frame's.
        """
        if frame.gray is None or frame.camera is None:
            return None
        around = self._motion.neighbours(index, 2)  # chosen for keypoints
        place = self._place(index, own, tuple(other for other, _ in around))
        if place is None:
            return None
        small = reduced(frame.gray, max(place.view.keypoints.size_px))
        query = KeypointView(frame.camera, keypoints(small, self._visible))
        sight = place.view.sight_of_scene(query, moved)
        # From a bad guess least squares does not converge; SQPnP needs no guess.
        sampled = start_by_points(place.structure, sight)
        sights = [sight] if sampled is None else [sight, replace(sight, moved=sampled)]
        alignments = [align(place.structure, start, PRECISION) for start in sights]
        best = max(filter(None, alignments), key=lambda result: result.inliers, default=None)
        if best is None:
            return None
        baseline_m = float(np.linalg.norm(place.neighbours, axis=1).max())
        return replace(best, baseline_m=baseline_m, neighbours=place.neighbours)


def _place(
    motion: MapMotion,
    view_of: Callable[[int, Camera], KeypointView | None],
    index: int,
    own: Camera,
    others: tuple[int, ...],
) -> _Place | None:
    """Return a place with the depths of its keypoints; None without neighbours."""
    view = view_of(index, own)
    if view is None:
        return None
    lens, sights = view.base_lens, []
    for other in others:
        moved, neighbour = motion.moved(index, other), view_of(other, own)
        if moved is not None and neighbour is not None:
            sights.append(view.sight(neighbour, inverse(lens) @ moved @ lens))
    if not sights:
        return None
    lenses = np.array([inverse(sight.moved)[:3, 3] for sight in sights])
    return _Place(view, triangulate(view.rays, sights), lenses)
