# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Where the robot was, against the place that it recognised: metric, from one camera.

A depth image of the reference gives depth to its regions, or else the field between it and
neighbours of its own drive, whose way the map's poses tell; the field between reference and query
then gives all of the pose. If another place lies nearer to what comes out, it is measured once
more from there: errors grow with the distance. Where the map keeps images, keypoints do the same
again, from there on and finer.
"""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

from convseq_ros.core.encoding.regions import REGION
from convseq_ros.core.geometry.alignment import align, ALIGNMENT, Alignment, two_view, unshrunk
from convseq_ros.core.geometry.displacement import Arranged, followed, found_in
from convseq_ros.core.geometry.structure import (
    DEPTH,
    is_usable,
    measured,
    rays,
    Sight,
    smoothed,
    Structure,
    triangulate,
)
from convseq_ros.core.geometry.uncertainty import base_pose, base_pose_of_two_views, ERROR
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.matcher import Features, Matcher
from convseq_ros.core.pose.image_pose import ImagePoses, LensView
from convseq_ros.core.pose.ways import WAYS, Ways
from convseq_ros.core.rigid import inverse, Matrix, matrix
from convseq_ros.core.types import (
    Camera,
    Candidate,
    constants,
    Doubles,
    Frame,
    Pose,
    RelativePose,
    Shift,
)
from convseq_ros.reading_config import ReadingConfig
import numpy as np

_KEPT = 64  # places whose measured depths are remembered


@constants
class FAR:
    """Of queries further off than the neighbours; chosen on drawn streets 41 to 44, and road_1."""

    baselines: float = 0.6  # of the way to the first neighbour, beyond which regions are followed
    rounds: int = 3  # 2 are worse at night, 5 alike
    precision = replace(ALIGNMENT.cells, sigmas=ALIGNMENT.cells.sigmas[-5:])


@dataclass(frozen=True, eq=False)
class CellView(LensView):
    """An image by its regions."""

    regions: Arranged

    @property
    def scale(self) -> Doubles:
        """Cells across and down for a length of 1 before the lens."""
        camera, cells = self.camera, self.regions.side + REGION.span - 1
        width, height = camera.width_px / cells, camera.height_px / cells
        return np.array((camera.fx_px / width, camera.fy_px / height))

    @cached_property
    def rays(self) -> Doubles:
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

    def sight_of_followed(self, other: 'CellView', moved: Matrix, inverse_m: Doubles) -> Sight:
        """Return the same, each region searched about where its inverse depth (n,) takes it."""
        went = np.nan_to_num(self._went(other, moved, inverse_m))
        places = followed(self.regions, other.regions, went)
        return Sight(rays(other.camera, places, self.regions.side), moved, other.scale)

    def _went(self, other: 'CellView', moved: Matrix, inverse_m: Doubles) -> Doubles:
        """Return by how many rows and columns regions of such inverse depths move, (n, 2)."""
        own = self.rays
        points = own @ moved[:3, :3].T + np.outer(inverse_m, moved[:3, 3])
        flat = points[:, :2] / np.maximum(points[:, 2:], DEPTH.least_ahead)
        return np.asarray((flat - own[:, :2]) * other.scale)[:, ::-1]

    def sight_from(self, other: 'CellView', moved: Matrix, start: tuple[int, int]) -> Sight:
        """Return the same, searched about rows and columns that everything moved."""
        places = found_in(self.regions, other.regions, start)
        return Sight(rays(other.camera, places, self.regions.side), moved, other.scale)


class RelativePoses:
    """Measures the pose of a query against the place that it shows."""

    def __init__(
        self,
        reference_map: ReferenceMap,
        matcher: Matcher,
        reading: ReadingConfig = ReadingConfig(),
    ) -> None:
        self._map, self._matcher = reference_map, matcher
        self.ways = Ways(reference_map)
        self._measured = lru_cache(_KEPT)(reference_map.depths)
        self._images = ImagePoses(reference_map, self.ways, reading.max_image_mpx)

    def measure(self, features: Features, frame: Frame, found: Candidate) -> RelativePose | None:
        """Return the pose of a query against a candidate; None if the images do not tell."""
        index, shift, camera = found.reference_index, found.shift, frame.camera
        if camera is None or shift is None or features.arranged is None:
            return None
        query, reference = CellView(camera, features.arranged), self._view(index, camera)
        if reference is None or not (is_usable(camera) and is_usable(reference.camera)):
            return None
        pose = self._by_cells(index, reference, query, shift)
        return self._by_images(index, reference, query, frame, pose) or pose

    def _by_cells(
        self, index: int, reference: CellView, query: CellView, shift: Shift
    ) -> RelativePose | None:
        sight = reference.sight_from(query, np.eye(4), (-round(shift[0]), -round(shift[1])))
        aligned = self._aligned(index, reference, sight, query)
        if aligned is None:
            both = two_view(reference.rays[:, :2], sight.seen, sight.scale)
            if both is None:
                return None
            pose = base_pose_of_two_views(both, reference.base_lens, query.base_lens)
            return replace(pose, explains=False) if self._knows_depth(index, reference) else pose
        pose = base_pose(aligned, reference.base_lens, query.base_lens)
        if (nearest := self.ways.nearest(index, pose)) != index:
            pose = self._measured_from(nearest, index, aligned, query) or pose
        return pose

    def _measured_from(
        self, nearest: int, index: int, aligned: Alignment, query: CellView
    ) -> RelativePose | None:
        """Return the pose against a place, measured from a nearer one; None if that fails."""
        between, reference = self.ways.moved(nearest, index), self._view(nearest, query.camera)
        if between is None or reference is None:
            return None
        lens = inverse(reference.base_lens) @ between @ reference.base_lens
        guess = aligned.moved @ lens
        again = self._aligned(nearest, reference, reference.sight(query, guess), query)
        if again is None:
            return None
        return base_pose(again, between @ reference.base_lens, query.base_lens)

    def _by_images(
        self, index: int, own: LensView, query: LensView, frame: Frame, known: RelativePose | None
    ) -> RelativePose | None:
        """Return the pose by kept images, from what cells said; None if too little agrees."""
        if not self._map.keeps_images:
            return None
        nearest = self.ways.nearest(index, known) if known else index
        if (between := self.ways.moved(nearest, index)) is None:
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

    def _aligned(
        self, index: int, reference: CellView, sight: Sight, query: CellView
    ) -> Alignment | None:
        """Return how a query is aligned with a place; None if no depth is known, or few agree."""
        depths_m = self._depths(index)
        if depths_m is not None:
            structure = measured(reference.rays, depths_m)
            found = _aligned_by_depth(structure, reference, sight, query)
            return found and _followed(found, structure, reference, query)
        around = self._neighbours(index, reference)
        if not around:
            return None
        sights = [reference.sight(view, moved) for view, moved in around]
        structure = triangulate(reference.rays, sights)
        found = align(structure, sight)
        if found is None:
            return None
        ways = np.array([inverse(moved)[:3, 3] for _, moved in around])
        baseline_m = float(np.linalg.norm(ways[0]))
        found = replace(found, baseline_m=baseline_m, neighbours=ways)
        found = unshrunk(found, ways[0] / baseline_m)
        if not _is_far(found):
            return found
        inverse_m = smoothed(structure)
        sights = [reference.sight_of_followed(view, moved, inverse_m) for view, moved in around]
        return _followed(found, triangulate(reference.rays, sights), reference, query)

    def _knows_depth(self, index: int, reference: CellView) -> bool:
        return self._depths(index) is not None or bool(self._neighbours(index, reference))

    def _depths(self, index: int) -> Doubles | None:
        """Return the measured depths of a place's regions, if any is known."""
        found = self._measured(index)
        return found if found is not None and np.isfinite(found).any() else None

    def _neighbours(self, index: int, reference: CellView) -> list[tuple[CellView, Matrix]]:
        """Return views of a place's neighbours, and the motions of the lens to them."""
        lens = reference.base_lens
        return [
            (view, inverse(lens) @ moved @ lens)
            for other, moved in self.ways.neighbours(index)
            if (view := self._view(other, reference.camera)) is not None
        ]

    def _view(self, index: int, camera: Camera) -> CellView | None:
        """Return a place as its session's camera saw it, or else one; None if it shows nothing."""
        regions = self._matcher.arranged(index)
        own = self._map.camera_of(index, camera)
        return None if regions is None else CellView(own, regions)


def _aligned_by_depth(
    structure: Structure, reference: CellView, sight: Sight, query: CellView
) -> Alignment | None:
    """Return how a query is aligned by depths that were measured, not by another field."""
    first = align(structure, sight)
    if first is None:
        return None
    # Once more, with what was seen searched about what the first found.
    again = reference.sight(query, first.moved)
    found = align(structure, again)
    return found and unshrunk(replace(found, baseline_m=WAYS.apart_m), None)


def _is_far(found: Alignment) -> bool:
    """Return whether regions may have moved further than they are searched."""
    return float(np.linalg.norm(found.moved[:3, 3])) > FAR.baselines * found.baseline_m


def _followed(
    first: Alignment, structure: Structure, reference: CellView, query: CellView
) -> Alignment:
    """Return an alignment, if it is far by what is seen where regions went by it, and again."""
    if not _is_far(first):
        return first
    found, inverse_m = first, smoothed(structure)
    for _ in range(FAR.rounds):
        sight = reference.sight_of_followed(query, found.moved, inverse_m)
        found = align(structure, sight, FAR.precision) or found
    known = first.baseline_m, first.neighbours
    return replace(found, first_share=first.share, baseline_m=known[0], neighbours=known[1])
