# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The background: what a map, or a drive, shows on average, region by region of the image.

All images of one road or corridor are laid out alike, so regions find counterparts where they lie
themselves, at the right place as elsewhere. Therefore it is subtracted: of references their map's,
of queries their own drive's, since the same scene looks otherwise at night.
"""

from collections.abc import Callable

from convseq_ros.core.encoding.regions import Cells, Regions
from convseq_ros.core.map.place import unpack_cells
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import constants
import numpy as np

_READ_AT_ONCE = 16  # places of the sample, for 1 MB of cells


@constants
class BACKGROUND:
    """Chosen on 29 sets, by day and darkened (docs/MATCHING.md), but for the sample."""

    fewest_places: int = 20  # a map of fewer has no background
    sample: int = 256  # places of the map that are read; more make no difference
    prior_frames: int = 5  # that the map's background counts for in the drive's
    still_alike: float = 0.8  # mean cosine of two frames, above which the later does not count


class Background:
    """
    The backgrounds of a map, `of_map` (N, 32), and of the drive that is matched with it.

    At most 256 places of the map are read, evenly spread, and others whenever it has doubled; none
    of a map of less than 20. `normalize` and `project` are those of a `PairScore`; without them
    nothing is subtracted, and cells are compared as they are.
    """

    def __init__(
        self,
        reference_map: ReferenceMap,
        normalize: Callable[[Cells], Cells] | None = None,
        project: Callable[[Cells], Regions] | None = None,
    ) -> None:
        self._map, self._project = reference_map, project
        self.normalizes, self.normalize = bool(normalize), normalize or (lambda cells: cells)
        self.of_map: Regions | None = None
        self._averaged = 0
        self.reset()

    def reset(self) -> None:
        self._last: Regions | None = None
        self._sum = np.zeros(1, np.float32)
        self._frames = 0

    def update_map(self) -> bool:
        """Read the map again if it has doubled, and return whether `of_map` has changed."""
        count = len(self._map)
        if not self._project or count < max(BACKGROUND.fewest_places, 2 * self._averaged):
            return False
        spread = np.linspace(0, count - 1, min(count, BACKGROUND.sample)).astype(int)
        sample, total, shown = np.unique(spread).tolist(), np.zeros(1, np.float32), 0
        for start in range(0, len(sample), _READ_AT_ONCE):
            packed = self._map.packed_of(sample[start : start + _READ_AT_ONCE])
            for cells in map(unpack_cells, packed):
                if cells.any():
                    total, shown = total + self._project(self.normalize(cells)), shown + 1
        self.of_map = total / np.float32(shown) if shown else None
        self._averaged = count
        return True

    def update(self, regions: Regions) -> Regions | None:
        """
        Take in a query's projected regions, once, and return the drive's background, (N, 32).

        A frame still much like the last that counted does not count; the map's background counts
        as 5 frames. None as long as the map has none.
        """
        if not self._project:
            return None
        alike, last = BACKGROUND.still_alike * len(regions), self._last
        # Not by BLAS, whose threads take longer to share so few products than one takes for all.
        if last is None or np.einsum('ij,ij', regions, last, dtype=np.float64) < alike:
            self._last, self._sum = regions, self._sum + regions
            self._frames += 1
        if self.of_map is None:
            return None
        total = self._sum + BACKGROUND.prior_frames * self.of_map
        return np.asarray(total / (self._frames + BACKGROUND.prior_frames), np.float32)
