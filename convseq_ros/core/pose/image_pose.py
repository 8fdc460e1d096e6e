# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Where a lens was against a place whose image the map keeps: by keypoints, far finer than cells.

Keypoints of the place get their depth from neighbours of its own drive that have images, too. By
night there are few keypoints, or none that agree: then there is no answer.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from typing import Any

from convseq_ros.core.encoding.descriptor import seen_cells
from convseq_ros.core.geometry.alignment import (
    align,
    ALIGNMENT,
    Alignment,
    Precision,
    start_by_points,
)
from convseq_ros.core.geometry.structure import Points, rays_through, Sight, Structure, triangulate
from convseq_ros.core.map.place import reduced
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.pose.ways import Ways
from convseq_ros.core.rigid import inverse, Matrix, matrix, ROBOT_LENS
from convseq_ros.core.types import Camera, constants, Doubles, Flags, Floats, Frame, Gray, Indices
import cv2
import numpy as np

_CV2: Any = cv2  # whose types lack SIFT
Pairs = Indices  # (m, 2), of a keypoint of the one image and its like in the other
_KEPT = 64  # places whose keypoints, and whose depths, are remembered; 30 MB at most


@constants
class KEYPOINT:
    """Of keypoints; chosen on road_1, road_2 and drawn streets (docs/GEOMETRY.md)."""

    most: int = 800  # of an image
    contrast: float = 0.01  # of OpenCV's SIFT; its usual .04 leaves too few at 320 px
    ratio: float = 0.85  # of the best to the second best distance, at most
    error_px: float = 1.0  # off an epipolar line
    unit_px: float = 2.0  # of a kept image, that count for keypoints as a cell does for regions


@dataclass(frozen=True, eq=False, slots=True)
class Keypoints:
    """What is found in an image; equal to itself only."""

    shares: Points  # (n, 2), across and down, of the image: in (0, 1)
    looks: Floats  # (n, 128)
    size_px: tuple[int, int]  # of the image, width and height


def keypoints(gray: Gray, seen: Flags) -> Keypoints:
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


def of_one_scene(one: Points, other: Points) -> Flags:
    """Return which of some pairs, in pixels without distortion, have one epipolar geometry."""
    none = np.zeros(len(one), np.bool_)
    if len(one) < ALIGNMENT.fewest_points:
        return none
    how = cv2.USAC_MAGSAC, KEYPOINT.error_px, ALIGNMENT.probability
    try:
        _, agree = cv2.findFundamentalMat(one, other, *how)
    except cv2.error:  # of all samples none had a geometry
        return none
    return none if agree is None else agree.ravel() > 0


@dataclass(frozen=True, eq=False)
class LensView:
    """A lens, and where it is."""

    camera: Camera

    @property
    def base_lens(self) -> Matrix:
        """Where the lens is in the base, (4, 4); looking along x if it is not known."""
        return matrix(self.camera.mount) @ ROBOT_LENS if self.camera.mount else ROBOT_LENS


@dataclass(frozen=True, eq=False)
class KeypointView(LensView):
    """An image by its keypoints."""

    keypoints: Keypoints

    @property
    def scale(self) -> Doubles:
        """Units across and down for a length of 1 before the lens."""
        width, height = self.keypoints.size_px
        camera = self.camera
        across, down = width / camera.width_px, height / camera.height_px
        return np.array((camera.fx_px * across, camera.fy_px * down)) / KEYPOINT.unit_px

    @cached_property
    def rays(self) -> Doubles:
        """Of each keypoint, (n, 3), z is 1; NaN where it cannot be told."""
        flat = rays_through(self.camera, self.keypoints.shares)
        return np.column_stack((flat, np.ones(len(flat))))

    def sight(self, other: 'KeypointView', moved: Matrix) -> Sight:
        """Return what another view, moved so (4, 4) from this lens, saw of these keypoints."""
        one, two = alike(self.keypoints, other.keypoints).T
        seen = np.full((len(self.rays), 2), np.nan)
        seen[one] = other.rays[two, :2]
        return Sight(seen, moved, other.scale)

    def sight_of_scene(self, other: 'KeypointView', moved: Matrix) -> Sight:
        """Return the same, without what no one motion explains; `moved` is a guess."""
        sight = self.sight(other, moved)
        own, seen = self.rays[:, :2], sight.seen
        known = np.flatnonzero(np.isfinite(seen).all(axis=1) & np.isfinite(own).all(axis=1))
        pixels = (own[known] * self.scale, seen[known] * other.scale)
        agree = of_one_scene(*(one * KEYPOINT.unit_px for one in pixels))
        seen[np.setdiff1d(np.arange(len(seen)), known[agree])] = np.nan
        return sight


# In units of keypoints. Wide at first, since the guess is as far off as a field.
PRECISION = Precision(
    sigmas=(8.0, 4.0, 2.0, 1.0, 1.0, 0.3, 0.3, 0.3, 0.3, 0.3, 0.3),
    agreeing=0.8,
    fewest=15,
    least_share=0.8,
)


@dataclass(frozen=True, eq=False, slots=True)
class _Place:
    """A place of the map with what its neighbours tell."""

    view: KeypointView
    structure: Structure
    neighbours: Doubles  # (k, 3), where they are, from the place's lens


class ImagePoses:
    """Aligns queries with the kept images of a map; `max_mpx` is the most that one may declare."""

    def __init__(self, reference_map: ReferenceMap, ways: Ways, max_mpx: float) -> None:
        self._ways = ways
        self._seen = seen = seen_cells(
            reference_map.encoding.image_mask, reference_map.cell_shape[0]
        )

        @lru_cache(_KEPT)
        def view_of(index: int, camera: Camera) -> KeypointView | None:
            gray = reference_map.image(index, max_mpx)
            return None if gray is None else KeypointView(camera, keypoints(gray, seen))

        self._place = lru_cache(_KEPT)(partial(_place, ways, view_of))

    def align(self, index: int, own: Camera, frame: Frame, moved: Matrix) -> Alignment | None:
        """
        Return how a frame is aligned with a place that a camera saw; None if too little agrees.

        `moved` (4, 4) is a guess of the motion from the place's lens to the frame's.
        """
        if frame.gray is None or frame.camera is None:
            return None
        around = self._ways.neighbours(index, 2)  # chosen for keypoints
        place = self._place(index, own, tuple(other for other, _ in around))
        if place is None:
            return None
        small = reduced(frame.gray, max(place.view.keypoints.size_px))
        query = KeypointView(frame.camera, keypoints(small, self._seen))
        sight = place.view.sight_of_scene(query, moved)
        # Far off, least squares ends where it began; points in space have no beginning.
        sampled = start_by_points(place.structure, sight)
        sights = [sight] if sampled is None else [sight, replace(sight, moved=sampled)]
        tried = [align(place.structure, one, PRECISION) for one in sights]
        found = max(filter(None, tried), key=lambda one: one.inliers, default=None)
        if found is None:
            return None
        baseline_m = float(np.linalg.norm(place.neighbours, axis=1).max())
        return replace(found, baseline_m=baseline_m, neighbours=place.neighbours)


def _place(
    ways: Ways,
    view_of: Callable[[int, Camera], KeypointView | None],
    index: int,
    own: Camera,
    others: tuple[int, ...],
) -> _Place | None:
    """Return the depths of a place's keypoints, by its neighbours; None if there are none."""
    view = view_of(index, own)
    if view is None:
        return None
    lens, sights = view.base_lens, []
    for one in others:
        moved, other = ways.moved(index, one), view_of(one, own)
        if moved is not None and other is not None:
            sights.append(view.sight(other, inverse(lens) @ moved @ lens))
    if not sights:
        return None
    lenses = np.array([inverse(sight.moved)[:3, 3] for sight in sights])
    return _Place(view, triangulate(view.rays, sights), lenses)
