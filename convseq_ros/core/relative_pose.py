# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Where the robot was, against the place that it recognised: metric, from one camera.

The field between the reference and neighbours of its own drive, whose way the map's poses tell,
gives depth to its regions; the field between reference and query then gives all of the pose. If
another place lies nearer to what comes out, it is measured once more from there: errors grow with
the distance.
"""

from dataclasses import dataclass, replace
from functools import cached_property
import math

from convseq_ros.core.compiled import kernels_of
from convseq_ros.core.constants import constants
from convseq_ros.core.geometry.alignment import align, Alignment, unshrunk
from convseq_ros.core.geometry.displacement import Arranged
from convseq_ros.core.geometry.lens import cell_px, is_usable, rays
from convseq_ros.core.geometry.structure import Floats, Sight, triangulate
from convseq_ros.core.geometry.two_view import two_view
from convseq_ros.core.geometry.uncertainty import base_pose, base_pose_of_two_views
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.matcher import Features, Matcher
from convseq_ros.core.rigid import inverse, Matrix, matrix, ROBOT_LENS
from convseq_ros.core.types import Camera, Candidate, Frame, RelativePose
import numpy as np


@constants
class PLACES:
    """Which places help; chosen on road_1, road_2 and drawn streets (docs/GEOMETRY.md)."""

    look: int = 10  # to either side, among which are neighbours
    on_one_side: int = 2  # where there are none on the other; one on either is better
    baseline_m: float = 1.8  # that a neighbour is off the place, and the next off the one before
    most_turned: float = 0.8  # cosine of the turn to a neighbour, at least
    usual_inverse_m: float = 0.05  # of depths, to guess where things went
    nearer_m: float = 0.3  # by which another place must lie nearer, to be measured from


@dataclass(frozen=True, eq=False)
class View:
    """An image and the lens that took it."""

    regions: Arranged
    camera: Camera

    @property
    def base_lens(self) -> Matrix:
        """Where the lens is in the base, (4, 4); looking along x if it is not known."""
        return matrix(self.camera.mount) @ ROBOT_LENS if self.camera.mount else ROBOT_LENS

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

    def sight(self, other: 'View', moved: Matrix) -> Sight:
        """Return what another view, moved so (4, 4) from this lens, saw of these regions."""
        own = self.rays
        points = own @ moved[:3, :3].T + PLACES.usual_inverse_m * moved[:3, 3]
        with np.errstate(invalid='ignore', divide='ignore'):
            went = (points[:, :2] / points[:, 2:] - own[:, :2]) * other.scale
        across, down = np.nan_to_num(np.nanmedian(went, axis=0)) if len(went) else (0.0, 0.0)
        return self.sight_from(other, moved, (round(down), round(across)))

    def sight_from(self, other: 'View', moved: Matrix, start: tuple[int, int]) -> Sight:
        """Return the same, searched about rows and columns that everything moved."""
        kernels, side = kernels_of('convseq_ros.core.geometry'), self.regions.side
        found = kernels.displacements(self.regions, other.regions, start).astype(np.float64)
        places = np.full((side**2, 2), np.nan)
        places[(found[:, 0] * side + found[:, 1]).astype(int)] = found[:, :2] + found[:, 2:4]
        return Sight(rays(other.camera, places, side), moved, other.scale)


class RelativePoses:
    """Measures the pose of a query against the place that it shows."""

    def __init__(self, reference_map: ReferenceMap, matcher: Matcher) -> None:
        self._map, self._matcher = reference_map, matcher

    def measure(self, features: Features, frame: Frame, found: Candidate) -> RelativePose | None:
        """Return the pose of a query against a candidate; None if the images do not tell."""
        index, shift, camera = found.reference_index, found.shift, frame.camera
        if camera is None or shift is None or features.arranged is None:
            return None
        query, reference = View(features.arranged, camera), self._view(index, camera)
        if reference is None or not (is_usable(camera) and is_usable(reference.camera)):
            return None
        start = -round(shift[0]), -round(shift[1])
        sight = reference.sight_from(query, np.eye(4), start)
        aligned = self._aligned(index, reference, sight)
        if aligned is None:
            both = two_view(reference.rays[:, :2], sight.seen, sight.scale)
            if both is None:
                return None
            return base_pose_of_two_views(both, reference.base_lens, query.base_lens)
        pose = base_pose(aligned, reference.base_lens, query.base_lens)
        if (nearest := self._nearest(index, pose)) != index:
            pose = self._measured_from(nearest, index, aligned, query) or pose
        return pose

    def _measured_from(
        self, nearest: int, index: int, aligned: Alignment, query: View
    ) -> RelativePose | None:
        """Return the pose against a place, measured from a nearer one; None if that fails."""
        between, reference = self._moved(nearest, index), self._view(nearest, query.camera)
        if between is None or reference is None:
            return None
        lens = inverse(reference.base_lens) @ between @ reference.base_lens
        guess = aligned.moved @ lens
        again = self._aligned(nearest, reference, reference.sight(query, guess))
        if again is None:
            return None
        return base_pose(again, between @ reference.base_lens, query.base_lens)

    def _aligned(self, index: int, reference: View, sight: Sight) -> Alignment | None:
        """Return how a query is aligned with a place; None if no depth is known, or few agree."""
        sights = [
            reference.sight(view, moved) for view, moved in self._neighbours(index, reference)
        ]
        if not sights:
            return None
        found = align(triangulate(reference.rays, sights), sight.seen, sight.scale, sight.moved)
        way = inverse(sights[0].moved)[:3, 3]
        baseline_m = float(np.linalg.norm(way))
        return found and unshrunk(replace(found, baseline_m=baseline_m), way / baseline_m)

    def _neighbours(self, index: int, reference: View) -> list[tuple[View, Matrix]]:
        """Return views of a place's own drive, one on either side or two on one, and the ways."""
        before, after = (self._on_side(index, side, reference) for side in (-1, 1))
        return [before[0], after[0]] if before and after else before + after

    def _on_side(self, index: int, side: int, reference: View) -> list[tuple[View, Matrix]]:
        """Return two views at most before a place (-1) or after it (1), and the ways to them."""
        found: list[tuple[View, Matrix]] = []
        last_m, lens = 0.0, reference.base_lens
        for step in range(1, PLACES.look + 1):
            moved = self._moved(index, other := index + side * step)
            if moved is None:
                break
            way_m = float(np.linalg.norm(moved[:3, 3]))
            if way_m < last_m + PLACES.baseline_m or moved[0, 0] < PLACES.most_turned:
                continue
            if (view := self._view(other, reference.camera)) is not None:
                found.append((view, inverse(lens) @ moved @ lens))
                last_m = way_m
                if len(found) == PLACES.on_one_side:
                    break
        return found

    def _nearest(self, index: int, pose: RelativePose) -> int:
        """Return the place of the same drive that lies nearest to a pose against a place."""
        places, own = self._map.places, self._map.places[index]
        if pose.position_m is None or own.pose is None:
            return index
        here = (matrix(own.pose) @ (*pose.position_m, 1.0))[:3]
        best, least_m = index, math.hypot(*pose.position_m) - PLACES.nearer_m
        first, end = max(0, index - PLACES.look), min(len(places), index + PLACES.look + 1)
        for other in range(first, end):
            one = places[other]
            if one.pose and one.session == own.session:
                if (way_m := math.dist(one.pose.position, here)) < least_m:
                    best, least_m = other, way_m
        return best

    def _moved(self, index: int, other: int) -> Matrix | None:
        """Return the motion from the base at a place to that at another of its drive, if known."""
        places = self._map.places
        if not (0 <= index < len(places) and 0 <= other < len(places)):
            return None
        one, two = places[index], places[other]
        if one.pose is None or two.pose is None or one.session != two.session:
            return None
        return inverse(matrix(two.pose)) @ matrix(one.pose)

    def _view(self, index: int, camera: Camera) -> View | None:
        """Return a place as its session's camera saw it, or else one; None if it shows nothing."""
        regions = self._matcher.arranged(index)
        own = self._map.camera_of(index, camera)
        return None if regions is None else View(regions, own)
