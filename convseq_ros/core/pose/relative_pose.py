# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The robot's pose relative to the place that it recognised: metric, from a single camera.

(1) The reference's regions get depths by triangulation with neighbours of the same drive, using
the map's poses. (2) The displacement field from reference to query gives the pose. (3) If another
place is at least 0.3 m nearer to the result, the pose is measured again from there, as errors grow
with the distance. (4) If the map keeps images, keypoints refine it.
"""

from dataclasses import dataclass, replace
from functools import cached_property
import math

from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.core.encoding.regions import REGION
from convseq_ros.core.geometry.alignment import (
    align,
    Alignment,
    base_pose,
    correct_parallax_loss,
    ERROR,
)
from convseq_ros.core.geometry.lens import is_usable, rays
from convseq_ros.core.geometry.structure import DEPTH, Sight, triangulate
from convseq_ros.core.geometry.verification import found_in, PackedRegions
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.pose.estimate import MapMotion
from convseq_ros.core.pose.image_pose import ImagePoses, LensView
from convseq_ros.core.rigid import base_between, inverse, Matrix, matrix
from convseq_ros.core.similarity.scorer import Features, Scorer
from convseq_ros.core.types import (
    Camera,
    Candidate,
    Doubles,
    Frame,
    Match,
    Pose,
    RelativePose,
    Shift,
)
import numpy as np


@dataclass(frozen=True, eq=False)
class CellView(LensView):
    """An image by its camera and its regions."""

    regions: PackedRegions

    @property
    def scale(self) -> Doubles:
        """Cells across and down per length of 1 in the plane z = 1."""
        camera, cells = self.camera, self.regions.side + REGION.span - 1
        width, height = camera.width_px / cells, camera.height_px / cells
        return np.array((camera.fx_px / width, camera.fy_px / height))

    @cached_property
    def rays(self) -> Doubles:
        """Rays of the regions, (n, 3), with z = 1; NaN where unknown."""
        side = self.regions.side
        grid = np.indices((side, side)).reshape(2, -1).T.astype(np.float64)
        flat = rays(self.camera, grid, side)
        return np.column_stack((flat, np.ones(len(flat))))

    def sight(self, other: 'CellView', moved: Matrix) -> Sight:
        """Return where another view, moved by (4, 4) from this lens, sees these regions."""
        here = self.rays
        points = here @ moved[:3, :3].T + DEPTH.usual_inverse_m * moved[:3, 3]
        flat = points[:, :2] / np.maximum(points[:, 2:], DEPTH.least_ahead)
        went = (flat - here[:, :2]) * other.scale
        across, down = np.nan_to_num(np.nanmedian(went, axis=0)) if len(went) else (0.0, 0.0)
        return self.sight_from(other, moved, (round(down), round(across)))

    def sight_from(self, other: 'CellView', moved: Matrix, start: tuple[int, int]) -> Sight:
        """Return `sight`, searching all regions around a common shift of rows and columns."""
        places = found_in(self.regions, other.regions, start)
        return Sight(rays(other.camera, places, self.regions.side), moved, other.scale)


class RelativePoses:
    """Measures the pose of a query relative to the place that it shows."""

    def __init__(
        self,
        reference_map: ReferenceMap,
        matcher: Scorer,
        reading: ReadingConfig = ReadingConfig(),
    ) -> None:
        self._map, self._matcher = reference_map, matcher
        self.motion = MapMotion(reference_map)
        self._images = ImagePoses(reference_map, self.motion, reading.max_image_mpx)

    def measure(self, features: Features, frame: Frame, found: Candidate) -> RelativePose | None:
        """Return the pose of a query relative to a candidate; None if it cannot be measured."""
        index, shift, camera = found.reference_index, found.shift, frame.camera
        if camera is None or shift is None or features.packed is None:
            return None
        query, reference = CellView(camera, features.packed), self._view(index, camera)
        if reference is None or not (is_usable(camera) and is_usable(reference.camera)):
            return None
        pose = self._by_cells(index, reference, query, shift)
        return self._by_images(index, reference, query, frame, pose) or pose

    def _by_cells(
        self, index: int, reference: CellView, query: CellView, shift: Shift
    ) -> RelativePose | None:
        sight = reference.sight_from(query, np.eye(4), (-round(shift[0]), -round(shift[1])))
        aligned = self._aligned(index, reference, sight)
        if aligned is None:
            return None
        pose = base_pose(aligned, reference.base_lens, query.base_lens)
        if (nearest := self.motion.nearest(index, pose)) != index:
            pose = self._measured_from(nearest, index, aligned, query) or pose
        return pose

    def _measured_from(
        self, nearest: int, index: int, aligned: Alignment, query: CellView
    ) -> RelativePose | None:
        """Return the pose relative to a place, measured from a nearer one; None if that fails."""
        between, reference = self.motion.moved(nearest, index), self._view(nearest, query.camera)
        if between is None or reference is None:
            return None
        lens = inverse(reference.base_lens) @ between @ reference.base_lens
        guess = aligned.moved @ lens
        again = self._aligned(nearest, reference, reference.sight(query, guess))
        if again is None:
            return None
        return base_pose(again, between @ reference.base_lens, query.base_lens)

    def _by_images(
        self, index: int, own: LensView, query: LensView, frame: Frame, known: RelativePose | None
    ) -> RelativePose | None:
        """Return the pose by kept images, starting at `known`, that of cells; None if it fails."""
        if not self._map.keeps_images:
            return None
        nearest = self.motion.nearest(index, known) if known else index
        if (between := self.motion.moved(nearest, index)) is None:
            return None
        guess = np.eye(4)
        if known:
            guess = matrix(known.pose or Pose((0.0, 0.0, 0.0), known.orientation))
        moved = inverse(query.base_lens) @ inverse(guess) @ between @ own.base_lens
        aligned = self._images.align(nearest, own.camera, frame, moved)
        if aligned is None:
            return None
        lens = between @ own.base_lens
        pose = base_pose(aligned, lens, query.base_lens, ERROR.keypoints)
        return pose if pose.position_m is not None else None

    def _aligned(self, index: int, reference: CellView, sight: Sight) -> Alignment | None:
        """Return the alignment of a query; None without neighbours, or if few regions agree."""
        around = self._neighbours(index, reference)
        if not around:
            return None
        sights = [reference.sight(view, moved) for view, moved in around]
        structure = triangulate(reference.rays, sights)
        result = align(structure, sight)
        if result is None:
            return None
        neighbours = np.array([inverse(moved)[:3, 3] for _, moved in around])
        baseline_m = float(np.linalg.norm(neighbours[0]))
        result = replace(result, baseline_m=baseline_m, neighbours=neighbours)
        return correct_parallax_loss(result, neighbours[0] / baseline_m)

    def _neighbours(self, index: int, reference: CellView) -> list[tuple[CellView, Matrix]]:
        """Return views of a place's neighbours, with the motions of the lens to them."""
        lens = reference.base_lens
        return [
            (view, inverse(lens) @ moved @ lens)
            for other, moved in self.motion.neighbours(index)
            if (view := self._view(other, reference.camera)) is not None
        ]

    def _view(self, index: int, camera: Camera) -> CellView | None:
        """Return a place's view by its session's camera, or else by `camera`; None if blank."""
        regions = self._matcher.packed(index)
        reference_camera = self._map.camera_of(index, camera)
        return None if regions is None else CellView(reference_camera, regions)


def shift_px(shift: Shift, height: int, width: int, cells_across: int) -> Shift:
    """Return a shift in pixels of an image, given in cells of the square made from the image."""
    return shift[0] * height / cells_across, shift[1] * width / cells_across


def relative_yaw(shift_px: Shift, camera: Camera) -> float:
    """
    Return by how many radians, in (-pi, pi), the query's camera is turned left.

    Half the shift lies on either side of the optical axis. Approximate: lens distortion is
    ignored, and a camera that moved sideways sees near things shift as well.
    """
    return -2.0 * math.atan(shift_px[1] / (2.0 * camera.fx_px))


def with_shift_and_yaw(match: Match, frame: Frame, reference_map: ReferenceMap) -> Match:
    """Return a match with its shift in pixels of the frame, and with the relative yaw."""
    best = match.best
    if best is None or best.shift is None or frame.gray is None:
        return match
    height, width = frame.gray.shape
    moved_px, yaw_rad = shift_px(best.shift, height, width, reference_map.cell_shape[1]), None
    if (camera := frame.camera) and camera.fx_px:
        turn = base_between(reference_map.camera_of(best.reference_index, camera), camera)
        yaw_rad = relative_yaw(moved_px, camera) + math.atan2(turn[1, 0], turn[0, 0])
        yaw_rad = math.remainder(yaw_rad, math.tau)
    return replace(match, shift_px=moved_px, relative_yaw_rad=yaw_rad)
