# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The background: the mean of each region of the image over a map, or over a drive.

All images of a road or corridor have the same layout, so regions find counterparts at their own
position at every place, right or wrong. Therefore the background is subtracted: the map's from
references, and the drive's from queries, since the same scene looks different at night.
"""

from convseq_ros.core.encoding.regions import Regions
from convseq_ros.core.map.place import unpack_cells
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.similarity.coherent import CoherentPair
from convseq_ros.core.types import constants
import numpy as np

_READ_AT_ONCE = 16  # places of the sample, for 1 MB of cells


@constants
class BACKGROUND:
    """Tuned on 29 sets, by day and darkened (commit ad68631c), except for the sample."""

    fewest_places: int = 20  # a map with fewer places has no background
    sample: int = 256  # number of places that are averaged; more make no difference
    prior_frames: int = 5  # weight of the map's background in the drive's, in frames
    still_alike: float = 0.8  # mean cosine of two frames from which the later one is skipped


class Background:
    """
    The backgrounds of a map, `of_map` (N, 32), and of the drive that is matched with it.

    It is the mean of up to 256 evenly spread places, computed again whenever the map has doubled.
    A map of fewer than 20 places has none. The `pair` normalises and projects.
    """

    def __init__(self, reference_map: ReferenceMap, pair: CoherentPair) -> None:
        self._map, self._pair = reference_map, pair
        self.of_map: Regions | None = None
        self._averaged = 0
        self.reset()

    def reset(self) -> None:
        self._last: Regions | None = None
        self._sum = np.zeros(1, np.float32)
        self._frames = 0

    def update_map(self) -> bool:
        """Average the map again if it has doubled; return whether `of_map` has changed."""
        count = len(self._map)
        if count < max(BACKGROUND.fewest_places, 2 * self._averaged):
            return False
        spread = np.linspace(0, count - 1, min(count, BACKGROUND.sample)).astype(int)
        sample, total, number = np.unique(spread).tolist(), np.zeros(1, np.float32), 0
        for start in range(0, len(sample), _READ_AT_ONCE):
            packed = self._map.packed_of(sample[start : start + _READ_AT_ONCE])
            for cells in map(unpack_cells, packed):
                if cells.any():
                    regions = self._pair.project(self._pair.normalize(cells))
                    total, number = total + regions, number + 1
        self.of_map = total / np.float32(number) if number else None
        self._averaged = count
        return True

    def update(self, regions: Regions) -> Regions | None:
        """
        Take in a query's projected regions, each only once; return the drive's background (N, 32).

        A frame that is too similar to the last counted one is skipped. The map's background counts
        as 5 frames. The result is None while the map has no background.
        """
        limit, last = BACKGROUND.still_alike * len(regions), self._last
        # Not by BLAS: for so few products, starting its threads takes longer than the work.
        if last is None or np.einsum('ij,ij', regions, last, dtype=np.float64) < limit:
            self._last, self._sum = regions, self._sum + regions
            self._frames += 1
        if self.of_map is None:
            return None
        total = self._sum + BACKGROUND.prior_frames * self.of_map
        return np.asarray(total / (self._frames + BACKGROUND.prior_frames), np.float32)
