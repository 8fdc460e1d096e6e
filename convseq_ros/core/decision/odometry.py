# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Odometry: steps that no robot can have made, how far it has driven, and where it may be by that.

Drift counts from the last match, one for each coordinate frame of the map; see `_initial_fix`.
"""

from array import array
from bisect import bisect_left
from dataclasses import dataclass
import math

from convseq_ros.config import RobotConfig
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.rigid import angle, inverse, Matrix, matrix
from convseq_ros.core.types import constants, Doubles, Indices, Pose, ROBOT
import numpy as np


class OdometryJumps:
    """Compares each pose with the one before."""

    def __init__(self) -> None:
        self.count = 0  # since the start
        self.reset()

    def reset(self) -> None:
        """Forget the drive."""
        self._last: tuple[int, Pose] | None = None

    def observe(self, stamp_ns: int, pose: Pose | None) -> bool:
        """Take in the next pose; return whether the step to it is too fast for a robot."""
        if pose is None:
            return False
        last, self._last = self._last, (stamp_ns, pose)
        if last is None:
            return False
        duration_s = max(0, stamp_ns - last[0]) / 1e9
        is_jump = math.dist(pose.position, last[1].position) > ROBOT.fastest_mps * duration_s
        self.count += is_jump
        return is_jump


class Odometer:
    """
    Adds up the steps between successive poses (4, 4) of the base in odometry.

    The motion has one for each camera: a keyframe without a pose breaks it off, since its mean
    step is that between keyframes. The odometry prior has one for all cameras of a robot, which
    goes on across such keyframes, since drift does.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Begin a drive."""
        self.distance_m, self.turn_rad, self.steps = 0.0, 0.0, 0
        self.forget_pose()

    def forget_pose(self) -> None:
        """Forget the last pose: the step to the next one is unknown."""
        self._last: Matrix | None = None

    def move(self, here: Matrix) -> float | None:
        """Take in the next pose; return its distance in metres from the last, < 0 in reverse."""
        last, self._last = self._last, here
        if last is None:
            return None
        moved = here[:3, 3] - last[:3, 3]
        step_m = math.hypot(*moved.tolist())
        self.distance_m += step_m
        self.turn_rad += angle(last[:3, :3].T @ here[:3, :3])
        self.steps += 1
        return math.copysign(step_m, float(moved @ last[:3, 0]))


@constants
class SLACK:
    """The error of a match itself; engineering, not studied."""

    places: float = 5.0  # in distances between the places on both sides
    least_m: float = 0.5


@dataclass(frozen=True, eq=False, slots=True)
class Fix:
    """A match: the transform between the coordinate frames of the map and of odometry."""

    map_odometry: Matrix  # (4, 4), from odometry to the map
    distance_m: float  # travelled distance at the match
    turn_rad: float  # sum of turns at the match
    by: int = 0  # id of the camera's prior that made the match


class OdometryPrior:
    """Compares places with odometry; in a map that `grows` it stores 24 bytes per keyframe."""

    def __init__(self, reference_map: ReferenceMap, config: RobotConfig, grows: bool) -> None:
        self._map, self._config, self._grows = reference_map, config, grows
        self._odometer = Odometer()  # both are shared by all cameras of a robot
        self._fixes = dict[str, Fix]()  # the last match, by coordinate frame
        self.reset()

    def use_matches_of(self, other: 'OdometryPrior') -> None:
        """Share the matches of another camera of the same base."""
        self._odometer, self._fixes = other._odometer, other._fixes

    def reset(self) -> None:
        self._here: Matrix | None = None
        self._odometer.reset()
        self.forget_poses()

    def forget_poses(self) -> None:
        """Forget matches and poses so far: odometry has jumped to other coordinates."""
        self._odometer.forget_pose()
        self._fixes.clear()
        self._stamps, self._distances_m, self._turns_rad = array('q'), array('d'), array('d')

    def move(self, stamp_ns: int, pose: Pose | None) -> None:
        """Take in the odometry pose of the next keyframe, if there is one."""
        self._here = None if pose is None else matrix(pose)
        if self._here is None:
            return
        self._odometer.move(self._here)
        if self._grows:
            self._stamps.append(stamp_ns)
            self._distances_m.append(self._odometer.distance_m)
            self._turns_rad.append(self._odometer.turn_rad)

    def entry_prior(self, places: Indices, session_start: int) -> Doubles:
        """Return the share (n,), in [0, 1], of mass that odometry allows to enter each place."""
        if self._here is None:
            return np.ones(len(places))
        off = [self._off(place, session_start) or (0.0, 0.0) for place in places.tolist()]
        return np.exp(-0.5 * np.array([sigmas for sigmas, _ in off]).clip(max=40.0) ** 2)

    def implausible_m(self, place: int, session_start: int) -> float | None:
        """Return the distance of a place beyond the possible drift; None if it is within."""
        off = self._off(place, session_start)
        return None if off is None or off[1] <= 0 else off[1]

    def is_denied(self, place: int, session_start: int) -> bool:
        """Return whether the match of another camera and odometry rule out a place."""
        fix = self._fixes.get(self._frame(place))
        is_other = fix is not None and fix.by != id(self)
        return is_other and self.implausible_m(place, session_start) is not None

    def fix(self, place: int) -> None:
        """Take in a match: the robot is at a place."""
        pose = self._map.places[place].pose
        if self._here is None or pose is None:
            return
        link = matrix(pose) @ inverse(self._here)
        self._fixes[self._frame(place)] = Fix(
            link, self._odometer.distance_m, self._odometer.turn_rad, id(self)
        )

    def _off(self, place: int, session_start: int) -> tuple[float, float] | None:
        """Return how far off a place is: sigmas beyond the slack, metres beyond the drift."""
        position = self._map.places.position(place)
        if self._here is None or position is None or not self._config.odometry_way_error:
            return None
        initial = self._initial_fix(place) if place >= session_start else None
        if (fix := self._fixes.get(self._frame(place)) or initial) is None:
            return None
        here = fix.map_odometry[:3, :3] @ self._here[:3, 3] + fix.map_odometry[:3, 3]
        off_m = math.dist(here, position) - self._slack_m(place)
        turn_rad = min(self._odometer.turn_rad - fix.turn_rad, math.tau)
        share = self._config.odometry_way_error + self._config.odometry_turn_error * turn_rad
        drift_m = share * (self._odometer.distance_m - fix.distance_m)
        # The bounds of the drift are two sigmas.
        return 2 * max(0.0, off_m) / max(drift_m, 1e-3), off_m - drift_m

    def _frame(self, place: int) -> str:
        session = self._map.sessions[self._map.places.session(place)]
        return session.frame or session.id  # a frame without a name is used by one session only

    def _initial_fix(self, place: int) -> Fix | None:
        """Return the state without drift when a place of the running drive was recorded."""
        stamp_ns = self._map.places[place].stamp_ns
        if not self._stamps or stamp_ns < self._stamps[0]:
            return None
        at = min(bisect_left(self._stamps, stamp_ns), len(self._stamps) - 1)
        return Fix(np.eye(4), self._distances_m[at], self._turns_rad[at])

    def _slack_m(self, place: int) -> float:
        """Return the error of a match in metres, by the distance to the neighbouring places."""
        near = self._map.bounds.around(place, 1)
        positions = [self._map.places.position(at) for at in near if at < len(self._map)]
        known = [position for position in positions if position is not None]
        distance_m = max(math.dist(first, second) for first in known for second in known)
        return max(SLACK.least_m, SLACK.places * distance_m)
