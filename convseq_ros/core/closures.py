# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What becomes of a sure match: its relative pose, odometry's veto, and the time between two."""

from dataclasses import replace
import math

from convseq_ros.config import AcceptanceConfig, Config
from convseq_ros.core.constants import constants
from convseq_ros.core.decision.plausibility import Plausibility
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.matcher import Features, Matcher
from convseq_ros.core.pose.relative_pose import RelativePoses
from convseq_ros.core.rigid import base_between, matrix
from convseq_ros.core.types import Frame, Match, Reason, RelativePose, Status
import numpy as np


@constants
class SLACK:
    """By how much a match itself may be off; engineering, not studied."""

    sigmas: float = 3.0  # of a measured position
    least_m: float = 0.5  # where one is measured
    places: float = 5.0  # where none is: so many times the way to the next place


@constants
class UNEXPLAINED:
    """Of a match of which one pose, or one motion, explains too little."""

    evidence: float = 2.0  # times `min_evidence`, that it needs; from drawn streets 1 and 2


class Closures:
    """Measures matches, refuses those that odometry denies, and keeps the others apart in time."""

    def __init__(self, reference_map: ReferenceMap, matcher: Matcher, config: Config) -> None:
        self._map, self._matcher = reference_map, matcher
        self._poses = RelativePoses(reference_map, matcher, config.reading)
        self._plausibility = Plausibility(config.robot, config.online.grows)
        self._accepted_ns: int | None = None

    def reset(self) -> None:
        """Forget the drive."""
        self._accepted_ns = None
        self._plausibility.reset()

    def share(self, other: 'Closures') -> None:
        """Have odometry deny what contradicts another camera's matches, too, and the reverse."""
        self._plausibility.share(other._plausibility)

    def move(self, frame: Frame) -> None:
        """Take in the odometry of the next keyframe."""
        self._plausibility.move(frame.stamp_ns, frame.pose)

    def update(
        self,
        match: Match,
        frame: Frame,
        features: Features,
        session_start: int,
        config: AcceptanceConfig = AcceptanceConfig(),
        evidence: float | None = None,
    ) -> Match:
        """
        Return an answer with candidates, complete; places from a start on are of this drive.

        The `evidence` is that of the best, if it is known. No match follows another one sooner
        than `closure_interval_s`; a refused one is none.
        """
        match = replace(match, candidates=self._matcher.with_shift(features, match.candidates))
        if match.reason is not Reason.ACCEPTED:
            return match
        best, last_ns = match.candidates[0], self._accepted_ns
        interval_ns = round(config.closure_interval_s * 1e9)
        is_due = last_ns is None or frame.stamp_ns - last_ns >= interval_ns
        pose = self._poses.measure(features, frame, best) if is_due else None
        if _is_unlikely(pose, evidence, config):
            return replace(match, reason=Reason.UNVERIFIED)
        place = self._map.places[best.reference_index]
        own_ns = place.stamp_ns if best.reference_index >= session_start else None
        if place.pose is not None:
            # At the place itself, if that is all that is known.
            moved = matrix(pose.pose) if pose and pose.pose else np.eye(4)
            if (camera := frame.camera) and not (pose and pose.pose):
                moved = base_between(self._map.camera_of(best.reference_index, camera), camera)
            said = place.pose, moved, self._slack_m(best.reference_index, pose)
            session = self._map.sessions[place.session]
            of = session.frame or session.id  # a frame without a name is the session's own
            excess_m = self._plausibility.excess_m(*said, own_ns, of)
            if excess_m is not None:
                return replace(match, reason=Reason.IMPLAUSIBLE, implausible_m=excess_m)
        if not is_due:
            return replace(match, reason=Reason.COOL_DOWN)
        self._accepted_ns = frame.stamp_ns
        return replace(match, status=Status.ACCEPTED, relative_pose=pose)

    def _slack_m(self, index: int, pose: RelativePose | None) -> float:
        """Return by how much a match may be off."""
        if pose is not None and (sigma_m := pose.position_sigma_m) is not None:
            return max(SLACK.least_m, SLACK.sigmas * sigma_m)
        places = self._map.places
        around = self._map.bounds.around(index, 1)
        near = [places[at].pose for at in around if at < len(places)]
        known = [one.position for one in near if one is not None]
        return SLACK.places * max(math.dist(a, b) for a in known for b in known)


def _is_unlikely(
    pose: RelativePose | None, evidence: float | None, config: AcceptanceConfig
) -> bool:
    """Return whether no pose explains what two images have in common, and evidence is small."""
    if pose is None or pose.explains or evidence is None:
        return False
    return evidence < UNEXPLAINED.evidence * config.min_evidence
