# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a frame says about where in the map the robot is."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

from convseq_ros.config import Config
from convseq_ros.core.constants import constants
from convseq_ros.core.decision.acceptance import Acceptance
from convseq_ros.core.decision.confidence import confidence
from convseq_ros.core.decision.likeliest import LIKELIEST
from convseq_ros.core.decision.neighbourhood import Neighbourhood
from convseq_ros.core.decision.verified_evidence import VERIFIED
from convseq_ros.core.map.place import Place
from convseq_ros.core.types import Match, Pose, Reason


@constants
class SIGHTING:
    """Engineering; scripts/relocalise.py measures what comes of it."""

    # Of an accepted match's evidence, with which a place counts as sure, as two must agree. What a
    # few frames alone say of wrong places is a third at most, on drawn nights (towns 107, 108).
    likely: float = 0.6
    near_m: float = 5.0  # beyond what odometry says, within which it is the same place
    # By which a drive moves on in the map without odometry, beside the rivals' distance. Quicker
    # ones are searched (6), but from a few keyframes on the way back from anywhere would be near.
    places_a_keyframe: int = 2
    # Of the strength that the place usually has, below which a sure match of it may be due to the
    # frames before: on drawn nights it has a third at once when the robot is carried away.
    weak: float = 0.5
    memory: float = 0.7  # share of the past in what is usual, per keyframe
    silent_keyframes: int = 30  # that recognise nothing, after which what was seen is forgotten


# Of frames whose best candidate is sure, and of those whose best one is denied.
_SURE = frozenset({Reason.ACCEPTED, Reason.COOL_DOWN})
_DENIED = frozenset({Reason.IMPLAUSIBLE, Reason.UNVERIFIED})


@dataclass(frozen=True, slots=True)
class Sighting:
    """A place that was recognised for sure, or nearly."""

    keyframe: int  # number of the frame that shows it
    reference: int
    odometry: Pose | None  # of that frame
    confidence: float | None
    quality: float | None  # that not both are false, this match and the one that agrees before it
    agreeing: int  # sightings that agree on where it is, one after another, up to this one
    is_sure: bool  # a sure match


class Sightings:
    """
    Knows which places of a map were recognised, one after another, and which of them agree.

    Two places agree if they are no further apart in the map than odometry says, or, where there is
    no odometry or no pose, near by their numbers.
    """

    def __init__(self, places: Sequence[Place], acceptance: Acceptance | None = None) -> None:
        self._places, self._acceptance = places, acceptance
        self._map = acceptance.places if acceptance else Neighbourhood()
        self._near_places = self._known = 0  # as each update has them
        self.reset()

    def reset(self) -> None:
        """Forget the drive."""
        self.keyframes = 0
        self.last: Sighting | None = None

    def update(
        self, match: Match, odometry: Pose | None, known: int, config: Config, is_lost: bool
    ) -> Sighting | None:
        """
        Return what a keyframe shows of the first `known` places, if anything.

        Once a robot `is_lost`, what odometry said before denies nothing.
        """
        self.keyframes, self._near_places = self.keyframes + 1, config.acceptance.rival_distance
        self._known, least = known, SIGHTING.likely * config.acceptance.min_evidence
        likely = self._acceptance.entered if self._acceptance else None
        is_sure = match.reason in _SURE or (is_lost and match.reason is Reason.IMPLAUSIBLE)
        if match.best and is_sure:
            reference, own = match.best.reference_index, match.confidence
        elif likely and likely[1] >= least and match.reason not in _DENIED:
            reference, own = likely[0], confidence(likely[1], 0.0)
        else:
            return None
        if reference >= known:
            return None
        before, count, sure = self.last, 1, own
        if before and (ago := self.keyframes - before.keyframe) < SIGHTING.silent_keyframes:
            # One that is not sure must lie on one way with the other, frame for frame.
            off = LIKELIEST.same_scene + math.floor(LIKELIEST.drift * ago)
            is_on_way = self._map.is_near(before.reference + ago, reference, off)
            agrees = self.agree(before, reference, odometry)
            if agrees and (is_on_way or (is_sure and before.is_sure)):
                count += before.agreeing
                sure = _either(before.confidence, sure)
        self.last = Sighting(self.keyframes, reference, odometry, own, sure, count, is_sure)
        return self.last

    def agree(self, sighting: Sighting, reference: int, odometry: Pose | None) -> bool:
        """Return whether the robot may have come from a sighting to a place."""
        before = sighting.reference
        then, now = self._places[before].pose, self._places[reference].pose
        comparable = self._map.are_in_one_frame(before, reference)
        if comparable and then and now and odometry and sighting.odometry:
            way_m = math.dist(odometry.position, sighting.odometry.position)
            return math.dist(then.position, now.position) <= SIGHTING.near_m + way_m
        keyframes = self.keyframes - sighting.keyframe
        reach = self._near_places + SIGHTING.places_a_keyframe * keyframes
        return self._map.is_near(reference, before, reach)

    def strengths(self, home: Sighting, odometry: Pose | None) -> tuple[float, float]:
        """Return the greatest strength of what is verified near `home`, and of the rest."""
        found = self._acceptance.strengths if self._acceptance else {}
        near = {one for one in found if self.agree(home, one, odometry)}
        here = max((found[one] for one in near), default=VERIFIED.least_strength)
        away = (found[one] for one in found if one not in near and one < self._known)
        return here, max(away, default=0.0)

    def is_settled(self, seen: Sighting) -> bool:
        """Return whether the newest one is verified no worse than places further along its way."""
        return self._acceptance is None or self._acceptance.is_settled(seen.reference)

    def rival(self, match: Match) -> int:
        """Return the best of the other candidates, at least one, that is another place."""
        first, *others = (one.reference_index for one in match.candidates)
        rivals = (one for one in others if not self._map.is_near(first, one, 0))
        return next(rivals, others[0])


def _either(first: float | None, second: float | None) -> float | None:
    """Return how sure it is that one of two is true, if they err apart; None if one is unknown."""
    return None if first is None or second is None else 1 - (1 - first) * (1 - second)
