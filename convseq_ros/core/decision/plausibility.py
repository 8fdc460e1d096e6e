# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Whether odometry allows a match: it may have drifted since the last one, but not by any distance.

Until three keyframes running agree on one other place: then it is odometry that was wrong, and its
drift is counted anew from there.
"""

from array import array
from bisect import bisect_left
from dataclasses import dataclass, field
import math

from convseq_ros.core.constants import constants
from convseq_ros.core.rigid import angle, inverse, Matrix, matrix
from convseq_ros.core.types import Pose
from convseq_ros.robot_config import RobotConfig
import numpy as np


@constants
class PLAUSIBLE:
    """Engineering, not studied."""

    agreeing: int = 3  # keyframes running that count more than odometry


@dataclass(frozen=True, eq=False, slots=True)
class Fix:
    """A match, as a link between the frames of the map and of odometry."""

    map_odometry: Matrix  # (4, 4)
    place: Matrix  # (4, 4), the reference in the map
    way_m: float  # that odometry had come then
    turn_rad: float
    keyframe: int
    slack_m: float = 0.0  # by how much the match itself may be off


@dataclass(eq=False, slots=True)
class Past:
    """How far odometry has come, and what was sure on the way; of all cameras of a robot."""

    last: Matrix | None = None  # (4, 4), where it was
    way_m: float = 0.0
    turn_rad: float = 0.0
    sure: dict[str, Fix] = field(default_factory=dict)  # the last, by frame
    count: int = 0  # of all that were sure

    def move(self, here: Matrix) -> None:
        """Take in where odometry is."""
        last = here if self.last is None else self.last
        self.way_m += float(np.linalg.norm(here[:3, 3] - last[:3, 3]))
        self.turn_rad += angle(last[:3, :3].T @ here[:3, :3])
        self.last = here

    def clear(self) -> None:
        """Forget the drive."""
        self.last, self.way_m, self.turn_rad = None, 0.0, 0.0
        self.sure.clear()


class Plausibility:
    """
    Compares matches with odometry; each frame of a map's poses is a map of its own.

    In a map that `grows`, it remembers how far odometry had come at each keyframe: 24 bytes.
    """

    def __init__(self, config: RobotConfig, grows: bool = True) -> None:
        self._config, self._grows = config, grows
        self._past = Past()
        self.reset()

    def share(self, other: 'Plausibility') -> None:
        """Have what either is sure of hold for both: two cameras of one base."""
        self._past = other._past

    def reset(self) -> None:
        """Forget the drive."""
        self._here: Matrix | None = None
        self._past.clear()
        self._keyframe = self._count = 0
        self._stamps, self._ways, self._turns = array('q'), array('d'), array('d')
        self._refused: list[Fix] = []

    def move(self, stamp_ns: int, pose: Pose | None) -> None:
        """Take in where odometry is at the next keyframe, if it tells."""
        self._keyframe += 1
        if pose is None:
            self._here = None
            return
        self._here = matrix(pose)
        self._past.move(self._here)
        if self._grows:
            self._stamps.append(stamp_ns)
            self._ways.append(self._past.way_m)
            self._turns.append(self._past.turn_rad)

    def excess_m(
        self,
        place: Pose,
        place_base: Matrix,
        slack_m: float,
        own_stamp_ns: int | None,
        frame: str = '',
    ) -> float | None:
        """
        Return by how much further off a match is than odometry may have drifted, if it is.

        Parameters
        ----------
        place : Pose
            The reference in the map.
        place_base : ndarray of float64, shape (4, 4)
            The query in the reference, as the match says.
        slack_m : float
            By how much that may be off.
        own_stamp_ns : int or None
            When the reference was taken, if by this session, whose map is in odometry's frame.
        frame : str
            The frame of the reference's pose.

        """
        if self._here is None or not self._config.odometry_way_error:
            return None
        there = matrix(place)
        link = there @ place_base @ inverse(self._here)
        past = self._past
        fix = Fix(link, there, past.way_m, past.turn_rad, self._keyframe, slack_m)
        sure = past.sure.get(frame) or self._first(own_stamp_ns, there)
        excess_m = 0.0 if sure is None else self._excess_m(fix, sure)
        if excess_m > 0 and not self._is_agreed(fix):
            return excess_m
        # A match that was not measured says less than odometry since one that was.
        if sure is None or excess_m > 0 or slack_m <= sure.slack_m + self._drift_m(fix, sure):
            past.sure[frame] = fix
        self._refused = []
        past.count += 1
        return None

    def _first(self, stamp_ns: int | None, there: Matrix) -> Fix | None:
        """Return what holds of a place of this session before it is matched: no drift then."""
        if stamp_ns is None or not self._stamps:
            return None
        at = min(bisect_left(self._stamps, stamp_ns), len(self._stamps) - 1)
        return Fix(np.eye(4), there, self._ways[at], self._turns[at], 0)

    def _excess_m(self, fix: Fix, sure: Fix) -> float:
        """Return by how much two links differ more than drift allows, where the robot is now."""
        here = np.zeros(3) if self._here is None else self._here[:3, 3]
        off_m = math.dist(
            fix.map_odometry[:3, :3] @ here + fix.map_odometry[:3, 3],
            sure.map_odometry[:3, :3] @ here + sure.map_odometry[:3, 3],
        )
        return off_m - max(fix.slack_m, sure.slack_m) - self._drift_m(fix, sure)

    def _drift_m(self, fix: Fix, sure: Fix) -> float:
        """Return how far odometry may have drifted from one match to another."""
        # The map's own odometry drifted between both places, too.
        way_m = fix.way_m - sure.way_m + math.dist(fix.place[:3, 3], sure.place[:3, 3])
        turn_rad = min(fix.turn_rad - sure.turn_rad, math.tau)
        share = self._config.odometry_way_error + self._config.odometry_turn_error * turn_rad
        return share * way_m

    def _is_agreed(self, fix: Fix) -> bool:
        """Return whether all last keyframes were refused for one other place, none was sure."""
        last = self._refused[-1].keyframe if self._refused else 0
        is_running = last == fix.keyframe - 1 and self._count == self._past.count
        if not is_running or self._excess_m(fix, self._refused[-1]) > 0:
            self._refused = []
        self._refused, self._count = [*self._refused, fix], self._past.count
        return len(self._refused) >= PLAUSIBLE.agreeing
