# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A map that grows from the robot's own past, and how much of that may be matched."""

import math

from convseq_ros.config import Config
from convseq_ros.core.map.reference_map import pack_cells, Place, ReferenceMap
from convseq_ros.core.map.thumbnail import thumbnail
from convseq_ros.core.types import Descriptor, Frame, Pose


class Growth:
    """
    Adds what the camera sees, and keeps it from being matched while it is recent.

    Parameters
    ----------
    reference_map : ReferenceMap
        Grows; what is in it already comes from earlier sessions.
    config : Config
        What is recent, and how wide the pictures are that are kept of its places.

    Attributes
    ----------
    session_start : int
        The first reference of this session.

    """

    def __init__(self, reference_map: ReferenceMap, config: Config) -> None:
        self._map = reference_map
        self._exclusion_ns = round(config.online.exclusion_s * 1e9)
        self._exclusion_m = config.online.exclusion_m
        self._width_px = config.keyframes.thumbnail_width_px
        self.reset()

    def reset(self) -> None:
        """Begin a new session: all that is in the map is the past."""
        self.session_start = self._usable = len(self._map)
        self._pose: Pose | None = None
        self._travelled_m = 0.0
        self._passed_m: list[float] = []

    def usable(self, stamp_ns: int, pose: Pose | None) -> int:
        """
        Return how many references, from the first, are old enough to be matched by a frame.

        Parameters
        ----------
        stamp_ns : int
            When the frame was taken.
        pose : Pose, optional
            Where, by odometry; the way from frame to frame is summed up.

        """
        if pose:
            if self._pose:
                self._travelled_m += math.dist(pose.position, self._pose.position)
            self._pose = pose
        while self._usable < len(self._map) and self._is_past(self._usable, stamp_ns):
            self._usable += 1
        return self._usable

    def add(self, frame: Frame, descriptor: Descriptor) -> None:
        """Add a frame to the map unless it could not be read."""
        if frame.gray is None:
            return
        small = thumbnail(frame.gray, self._width_px)
        place = Place(frame.stamp_ns, frame.source, frame.pose)
        self._map.add(place, pack_cells(descriptor.cells), small)
        self._passed_m.append(self._travelled_m)

    def _is_past(self, index: int, stamp_ns: int) -> bool:
        age_ns = stamp_ns - self._map.places[index].stamp_ns
        way_m = self._travelled_m - self._passed_m[index - self.session_start]
        known = self._pose is not None
        return age_ns >= self._exclusion_ns and (not known or way_m >= self._exclusion_m)
