# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What becomes of a match: its shift, its relative pose, and the time between two."""

from dataclasses import replace

from convseq_ros.config import AcceptanceConfig, Config
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.matcher import Features, Matcher
from convseq_ros.core.pose.relative_pose import RelativePoses
from convseq_ros.core.types import Anchor, Frame, Match, Reason, Status


class Closures:
    """Measures matches, and keeps them apart in time."""

    def __init__(self, reference_map: ReferenceMap, matcher: Matcher, config: Config) -> None:
        self._map, self._matcher = reference_map, matcher
        self._poses = RelativePoses(reference_map, matcher, config.reading)
        self._accepted_ns: int | None = None

    def reset(self) -> None:
        self._accepted_ns = None

    def complete(
        self, match: Match, frame: Frame, features: Features, config: AcceptanceConfig
    ) -> Match:
        """Return an answer complete; no match follows another sooner than `closure_interval_s`."""
        if not match.candidates:
            return match
        match = replace(match, candidates=self._matcher.with_shift(features, match.candidates))
        if match.reason is not Reason.ACCEPTED:
            return match
        last_ns, interval_ns = self._accepted_ns, round(config.closure_interval_s * 1e9)
        if last_ns is not None and frame.stamp_ns - last_ns < interval_ns:
            return replace(match, reason=Reason.COOL_DOWN)
        self._accepted_ns = frame.stamp_ns
        pose = self._poses.measure(features, frame, match.candidates[0])
        anchor = self._anchor(match.candidates[0].reference_index)
        return replace(match, status=Status.ACCEPTED, relative_pose=pose, anchor=anchor)

    def _anchor(self, index: int) -> Anchor:
        place = self._map.places[self._map.links.anchor(index)]
        return Anchor(self._map.sessions[place.session].id, place.stamp_ns)
