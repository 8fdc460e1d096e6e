# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Where a lens was against a place whose image the map keeps: by keypoints, far finer than cells.

Keypoints of the place get their depth from neighbours of its own drive that have images, too. By
night there are few keypoints, or none that agree: then there is no answer.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial

from convseq_ros.core.constants import constants
from convseq_ros.core.encoding.descriptor import seen_cells
from convseq_ros.core.geometry.alignment import align, Alignment, Precision, start_by_points
from convseq_ros.core.geometry.keypoints import keypoints
from convseq_ros.core.geometry.structure import Floats, Structure, triangulate
from convseq_ros.core.map.kept_image import reduced
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.pose.views import KeypointView
from convseq_ros.core.pose.ways import Ways
from convseq_ros.core.rigid import inverse, Matrix
from convseq_ros.core.types import Camera, Frame
import numpy as np
import numpy.typing as npt


@constants
class IMAGE_POSE:
    """Chosen on road_1, road_2 and drawn streets (docs/GEOMETRY.md)."""

    apart_m: float = 0.9  # of neighbours from the place, and from each other
    neighbours: int = 4
    kept: int = 64  # places whose keypoints, and whose depths, are remembered; 30 MB at most


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
    neighbours: Floats  # (k, 3), where they are, from the place's lens


class ImagePoses:
    """Aligns queries with the kept images of a map; `max_mpx` is the most that one may declare."""

    def __init__(self, reference_map: ReferenceMap, ways: Ways, max_mpx: float) -> None:
        self._ways = ways
        self._seen = seen_cells(reference_map.encoding.image_mask, reference_map.cell_shape[0])
        remember = lru_cache(IMAGE_POSE.kept)
        view = remember(partial(_view, reference_map, self._seen, max_mpx))
        self._place = remember(partial(_place, ways, view))

    def align(self, index: int, own: Camera, frame: Frame, moved: Matrix) -> Alignment | None:
        """
        Return how a frame is aligned with a place that a camera saw; None if too little agrees.

        `moved` (4, 4) is a guess of the motion from the place's lens to the frame's.
        """
        if frame.gray is None or frame.camera is None:
            return None
        around = self._ways.neighbours(index, IMAGE_POSE.apart_m, IMAGE_POSE.neighbours)
        place = self._place(index, own, tuple(other for other, _ in around))
        if place is None:
            return None
        small = reduced(frame.gray, max(place.view.keypoints.size_px))
        query = KeypointView(frame.camera, keypoints(small, self._seen))
        sight = place.view.sight_of_scene(query, moved)
        # Far off, least squares ends where it began; points in space have no beginning.
        sampled = start_by_points(place.structure, sight)
        starts = [moved] if sampled is None else [moved, sampled]
        tried = [align(place.structure, sight.seen, sight.scale, one, PRECISION) for one in starts]
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


def _view(
    reference_map: ReferenceMap,
    seen: npt.NDArray[np.bool_],
    max_mpx: float,
    index: int,
    camera: Camera,
) -> KeypointView | None:
    """Return a place by its keypoints; None if its image was not kept, or is damaged."""
    gray = reference_map.images.image(index, max_mpx)
    return None if gray is None else KeypointView(camera, keypoints(gray, seen))
