# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""When what is told of a map is to be told again."""

import time

from convseq_ros.core.map.reference_map import ReferenceMap

_PERIOD_S = 5.0


class MapNews:
    """
    Knows of which map was told last, and when.

    Attributes
    ----------
    told : ReferenceMap or None
        The map; None before the first.

    """

    def __init__(self) -> None:
        self.told: ReferenceMap | None = None
        self._length, self._told_s = 0, 0.0

    def update(self, reference_map: ReferenceMap) -> bool:
        """Return whether to tell now: of another map at once, of one that grew every 5 s."""
        length, now_s = len(reference_map), time.monotonic()
        if reference_map is self.told and (
            length == self._length or now_s - self._told_s < _PERIOD_S
        ):
            return False
        self.told, self._length, self._told_s = reference_map, length, now_s
        return True
