# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Standstill, by odometry or, without it, by the image."""

import math

from convseq_ros.config import MotionConfig
from convseq_ros.core.gate.near_duplicate import distance, GLANCE, Glance
from convseq_ros.core.similarity.overlap import PaperSimilarity
from convseq_ros.core.types import constants, Descriptor, Pose


@constants
class NEAR:
    """Engineering."""

    turn_rad: float = math.tau / 20  # smallest turn that counts as motion


def near(pose: Pose, other: Pose, distance_m: float) -> bool:
    """Return whether a pose is within a distance of another, and turned by less than 18°."""
    cosine = abs(sum(a * b for a, b in zip(pose.orientation, other.orientation, strict=True)))
    turn_rad = 2 * math.acos(min(cosine, 1.0))
    return math.dist(pose.position, other.position) < distance_m and turn_rad < NEAR.turn_rad


class Standstill:
    """Detects standstill by the last frame that moved, so that slow motion adds up."""

    def __init__(self, config: MotionConfig, by_image: bool, similarity: PaperSimilarity) -> None:
        self._config, self._similarity = config, similarity
        self._by_image = by_image and config.stationary_overlap < 1.0  # if there is no odometry
        self._most_apart = GLANCE.still * (1.0 - config.stationary_overlap)
        self.reset()

    def configure(self, config: MotionConfig) -> None:
        """Use another `stationary_m` from now on."""
        self._config = config

    def reset(self) -> None:
        self._pose: Pose | None = None
        self._edges: Glance | None = None
        self._descriptor: Descriptor | None = None

    def check(
        self, descriptor: Descriptor, pose: Pose | None, edges: Glance | None = None
    ) -> bool:
        """Return whether the robot stands still at a frame; False if it is uninformative."""
        if not descriptor.informative:
            return False
        if (still := self._by_pose(pose)) is None:
            still, last = False, self._descriptor
            if self._by_image and last is not None and not self._off(edges) > GLANCE.moved:
                most = self._config.stationary_overlap
                still = self._similarity(descriptor, last, most) > most
        if not still:
            self._pose, self._edges, self._descriptor = pose, edges, descriptor
        return still

    def is_sure(self, pose: Pose | None, edges: Glance | None) -> bool:
        """Return whether the robot surely stands still, by its pose or a near-duplicate test."""
        if not self.needs_image(pose):
            return bool(self._by_pose(pose))
        return self._off(edges) < self._most_apart

    def _off(self, edges: Glance | None) -> float:
        """Return the distance of a glance from that of the last frame that moved, or NaN."""
        return math.nan if edges is None or self._edges is None else distance(edges, self._edges)

    def note_passed(self, pose: Pose | None, edges: Glance | None) -> None:
        """Store the pose and glance of a frame that moved and is not described."""
        self._pose, self._edges = pose or self._pose, edges

    def needs_image(self, pose: Pose | None) -> bool:
        """Return whether the image decides, because there is no pose to compare."""
        return self._by_image and self._by_pose(pose) is None

    def _by_pose(self, pose: Pose | None) -> bool | None:
        if pose and self._pose and self._config.stationary_m:
            return near(pose, self._pose, self._config.stationary_m)
        return None
