# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Images with the lens that took them, as the relative pose reads them: by cells or keypoints."""

from dataclasses import dataclass
from functools import cached_property

from convseq_ros.core.compiled import kernels_of
from convseq_ros.core.constants import constants
from convseq_ros.core.geometry.displacement import Arranged
from convseq_ros.core.geometry.following import followed
from convseq_ros.core.geometry.keypoints import alike, Keypoints, of_one_scene
from convseq_ros.core.geometry.lens import cell_px, rays, rays_through
from convseq_ros.core.geometry.structure import DEPTH, Floats, Sight
from convseq_ros.core.rigid import Matrix, matrix, ROBOT_LENS
from convseq_ros.core.types import Camera
import numpy as np


@constants
class VIEW:
    """Of both kinds; the unit was chosen on road_1, road_2 and drawn streets."""

    unit_px: float = 2.0  # of a kept image, that count for keypoints as a cell does for regions


@dataclass(frozen=True, eq=False)
class LensView:
    """A lens, and where it is."""

    camera: Camera

    @property
    def base_lens(self) -> Matrix:
        """Where the lens is in the base, (4, 4); looking along x if it is not known."""
        return matrix(self.camera.mount) @ ROBOT_LENS if self.camera.mount else ROBOT_LENS


@dataclass(frozen=True, eq=False)
class CellView(LensView):
    """An image by its regions."""

    regions: Arranged

    @property
    def scale(self) -> Floats:
        """Cells across and down for a length of 1 before the lens."""
        height, width = cell_px(self.camera, self.regions.side)
        return np.array((self.camera.fx_px / width, self.camera.fy_px / height))

    @cached_property
    def rays(self) -> Floats:
        """Of each region, (n, 3), z is 1; NaN where it cannot be told."""
        side = self.regions.side
        grid = np.indices((side, side)).reshape(2, -1).T.astype(np.float64)
        flat = rays(self.camera, grid, side)
        return np.column_stack((flat, np.ones(len(flat))))

    def sight(self, other: 'CellView', moved: Matrix) -> Sight:
        """Return what another view, moved so (4, 4) from this lens, saw of these regions."""
        went = self._went(other, moved, np.full(len(self.rays), DEPTH.usual_inverse_m))
        down, across = np.nan_to_num(np.nanmedian(went, axis=0)) if len(went) else (0.0, 0.0)
        return self.sight_from(other, moved, (round(down), round(across)))

    def sight_of_followed(self, other: 'CellView', moved: Matrix, inverse_m: Floats) -> Sight:
        """Return the same, each region searched about where its inverse depth (n,) takes it."""
        went = np.nan_to_num(self._went(other, moved, inverse_m))
        places = followed(self.regions, other.regions, went)
        return Sight(rays(other.camera, places, self.regions.side), moved, other.scale)

    def _went(self, other: 'CellView', moved: Matrix, inverse_m: Floats) -> Floats:
        """Return by how many rows and columns regions of such inverse depths move, (n, 2)."""
        own = self.rays
        points = own @ moved[:3, :3].T + np.outer(inverse_m, moved[:3, 3])
        flat = points[:, :2] / np.maximum(points[:, 2:], DEPTH.least_ahead)
        return np.asarray((flat - own[:, :2]) * other.scale)[:, ::-1]

    def sight_from(self, other: 'CellView', moved: Matrix, start: tuple[int, int]) -> Sight:
        """Return the same, searched about rows and columns that everything moved."""
        kernels, side = kernels_of('convseq_ros.core.geometry'), self.regions.side
        found = kernels.displacements(self.regions, other.regions, start).astype(np.float64)
        places = np.full((side**2, 2), np.nan)
        places[(found[:, 0] * side + found[:, 1]).astype(int)] = found[:, :2] + found[:, 2:4]
        return Sight(rays(other.camera, places, side), moved, other.scale)


@dataclass(frozen=True, eq=False)
class KeypointView(LensView):
    """An image by its keypoints."""

    keypoints: Keypoints

    @property
    def scale(self) -> Floats:
        """Units across and down for a length of 1 before the lens."""
        width, height = self.keypoints.size_px
        camera = self.camera
        across, down = width / camera.width_px, height / camera.height_px
        return np.array((camera.fx_px * across, camera.fy_px * down)) / VIEW.unit_px

    @cached_property
    def rays(self) -> Floats:
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
        agree = of_one_scene(*(one * VIEW.unit_px for one in pixels))
        seen[np.setdiff1d(np.arange(len(seen)), known[agree])] = np.nan
        return sight
