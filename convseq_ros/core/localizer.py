# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether it is known where in the map the robot is, frame after frame."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

from convseq_ros.config import Config
from convseq_ros.core.constants import constants
from convseq_ros.core.decision.acceptance import Acceptance
from convseq_ros.core.decision.confidence import confidence
from convseq_ros.core.decision.neighbourhood import Neighbourhood
from convseq_ros.core.decision.verified_evidence import VERIFIED
from convseq_ros.core.map.place import Place
from convseq_ros.core.types import Localization, LocalizationState, Match, Pose, Reason


@constants
class LOCALIZER:
    """Engineering; scripts/relocalise.py measures what comes of it."""

    # Of an accepted match's evidence, with which a place counts as sure, as two must agree. What a
    # few frames alone say of wrong places is a third at most, on drawn nights (towns 107, 108).
    likely: float = 0.6
    near_m: float = 5.0  # beyond what odometry says, within which it is the same place
    # By which a drive moves on in the map without odometry, beside the rivals' distance. Quicker
    # ones are searched (6), but from a few keyframes on the way back from anywhere would be near.
    places_a_keyframe: int = 2
    silent_keyframes: int = 30  # that recognise nothing, after which what was seen is forgotten


# Of frames that say nothing about the place.
_SILENT = frozenset(
    {
        Reason.BETWEEN_KEYFRAMES, Reason.STATIONARY, Reason.UNINFORMATIVE, Reason.UNREADABLE,
        Reason.OUT_OF_ORDER,
    }
)  # fmt: skip
# Of frames whose best candidate is sure, and of those whose best one is denied.
_SURE = frozenset({Reason.ACCEPTED, Reason.COOL_DOWN})
_DENIED = frozenset({Reason.IMPLAUSIBLE, Reason.UNVERIFIED})


@dataclass(frozen=True, slots=True)
class _Sighting:
    """A place that was recognised for sure, or nearly."""

    keyframe: int  # number of the frame that shows it
    reference: int
    odometry: Pose | None  # of that frame
    confidence: float | None
    quality: float | None  # that not both are false, this match and the one that agrees before it
    agreeing: int  # sightings that agree on where it is, one after another, up to this one
    is_sure: bool  # a sure match


class Localizer:
    """
    Holds `lost`, `candidate` or `localised` over the matches of a drive.

    A sure match is a candidate, and so is a place for which the newest few frames alone speak with
    .6 of a match's evidence; `localize_keyframes` that agree make it localised, a second time only
    if the last is sure. It stays so while nothing speaks against it. Two places agree if they are
    no further apart in the map than odometry says, or, where there is no odometry or no pose, near
    by their numbers. `lost_keyframes` in a row that show another place, or the same no better than
    another, make it lost, and so do `localize_keyframes` that agree on another one. From then on
    odometry denies no match. In a map that grows only the places of earlier sessions count.
    """

    def __init__(
        self, places: Sequence[Place], config: Config, acceptance: Acceptance | None = None
    ) -> None:
        self._places, self._config, self._acceptance = places, config.localization, acceptance
        self._map = acceptance.places if acceptance else Neighbourhood()
        self._near_places, self._least_evidence = 0, 0.0  # as each update has them
        self.reset()

    def reset(self) -> None:
        """Forget the drive."""
        self._keyframes = self._against = 0
        self._home: _Sighting | None = None  # where it is localised
        self._seen: _Sighting | None = None  # the last sure match
        self._lost_at = 0  # keyframe at which it was lost
        self._reasons: Counter[Reason] = Counter()  # since it was lost
        self._last: Match | None = None

    def update(self, match: Match, odometry: Pose | None, known: int, config: Config) -> Match:
        """
        Return a match with what is known after it.

        `odometry` tells where the frame was taken; the first `known` places are of earlier
        sessions.
        """
        self._near_places = config.acceptance.rival_distance
        self._least_evidence = LOCALIZER.likely * config.acceptance.min_evidence
        if match.reason not in _SILENT:
            self._keyframes, self._last = self._keyframes + 1, match
            self._reasons[match.reason] += 1
            seen = self._sighting(match, odometry, known)
            self._seen = seen or self._seen
            if self._home:
                self._keep_or_lose(self._home, match, seen, odometry)
            elif seen and self._is_enough(seen) and (seen.is_sure or not self._lost_at):
                self._home = seen
        return replace(match, localization=self.localization)

    @property
    def localization(self) -> Localization:
        """What is known now."""
        if home := self._home:
            doubt = self._against / self._config.lost_keyframes
            sure = None if home.quality is None else home.quality * (1 - doubt)
            return Localization(LocalizationState.LOCALISED, sure, home.reference)
        seen, problem = self._seen, self._problem()
        recent = seen and self._keyframes - seen.keyframe < self._config.lost_keyframes
        if seen and recent and self._keyframes > self._lost_at:
            return Localization(LocalizationState.CANDIDATE, seen.quality, seen.reference, problem)
        return Localization(problem=problem)

    def _sighting(self, match: Match, odometry: Pose | None, known: int) -> _Sighting | None:
        likely = self._acceptance.entered if self._acceptance else None
        # What odometry said before the robot was lost denies nothing afterwards.
        is_sure = match.reason in _SURE or (
            match.reason is Reason.IMPLAUSIBLE and self._lost_at > 0 and self._home is None
        )
        if match.best and is_sure:
            reference, own = match.best.reference_index, match.confidence
        elif likely and likely[1] >= self._least_evidence and match.reason not in _DENIED:
            reference, own = likely[0], confidence(likely[1])
        else:
            return None
        if reference >= known:
            return None
        before, count, sure = self._seen, 1, own
        if before and (ago := self._keyframes - before.keyframe) < LOCALIZER.silent_keyframes:
            # One that is not sure must lie on one way with the other, frame for frame.
            off = VERIFIED.same_scene + math.floor(VERIFIED.drift * ago)
            is_on_way = self._map.is_near(before.reference + ago, reference, off)
            agrees = self._agree(before, reference, odometry)
            if agrees and (is_on_way or (is_sure and before.is_sure)):
                count += before.agreeing
                sure = _either(before.confidence, sure)
        return _Sighting(self._keyframes, reference, odometry, own, sure, count, is_sure)

    def _keep_or_lose(
        self, home: _Sighting, match: Match, seen: _Sighting | None, odometry: Pose | None
    ) -> None:
        is_like_another = self._is_like_another(home, match, odometry)
        if seen and self._agree(home, seen.reference, odometry):
            self._home, seen = seen, None
            if not is_like_another:
                self._against = 0
                return
        best = match.best
        is_elsewhere = best is not None and not self._agree(home, best.reference_index, odometry)
        is_against = is_elsewhere or is_like_another or match.reason is Reason.INCONSISTENT
        self._against = self._against + 1 if is_against else 0
        if (
            self._against >= self._config.lost_keyframes
            or (seen and self._is_enough(seen))
            or self._keyframes - home.keyframe >= LOCALIZER.silent_keyframes
        ):
            self._home, self._against, self._lost_at = None, 0, self._keyframes
            # What agreed with the old place so far counts no longer.
            self._seen = seen
            self._reasons.clear()

    def _is_like_another(self, home: _Sighting, match: Match, odometry: Pose | None) -> bool:
        """Return whether a place elsewhere is verified as well as the best one, or nearly."""
        if match.best is None or self._acceptance is None:
            return False
        rivals = self._acceptance.as_good_as(match.best.reference_index)
        return any(not self._agree(home, one, odometry) for one in rivals)

    def _is_enough(self, seen: _Sighting) -> bool:
        return seen.agreeing >= self._config.localize_keyframes

    def _agree(self, sighting: _Sighting, reference: int, odometry: Pose | None) -> bool:
        """Return whether the robot may have come from a sighting to a place."""
        before = sighting.reference
        then, now = self._places[before].pose, self._places[reference].pose
        comparable = self._map.are_in_one_frame(before, reference)
        if comparable and then and now and odometry and sighting.odometry:
            way_m = math.dist(odometry.position, sighting.odometry.position)
            return math.dist(then.position, now.position) <= LOCALIZER.near_m + way_m
        keyframes = self._keyframes - sighting.keyframe
        reach = self._near_places + LOCALIZER.places_a_keyframe * keyframes
        return self._map.is_near(reference, before, reach)

    def _problem(self) -> str:
        """Return why it is not localised."""
        last, seen = self._last, self._seen
        if last is None:
            return 'too few frames: none that shows anything new was seen'
        if last.reason in (Reason.NO_MAP, Reason.RECENT):
            return 'there is no map: no place of an earlier session may be matched'
        if last.reason is Reason.AMBIGUOUS and len(last.candidates) > 1:
            first, *others = (one.reference_index for one in last.candidates)
            rivals = (one for one in others if not self._map.is_near(first, one, 0))
            return f'ambiguous between place {first} and place {next(rivals, others[0])}'
        if seen and self._keyframes - seen.keyframe < self._config.lost_keyframes:
            return (
                f'too few frames: {seen.agreeing} of {self._config.localize_keyframes} matches '
                f'agree on place {seen.reference}'
            )
        count = sum(self._reasons.values())
        if self._reasons[Reason.WARMING_UP] == count:
            return f'too few frames: {count} that show anything new, and more make a sequence'
        told = ', '.join(f'{number} {one}' for one, number in self._reasons.most_common())
        return f'nothing recognised in {count} keyframes ({told})'


def _either(first: float | None, second: float | None) -> float | None:
    """Return how sure it is that one of two is true, if they err apart; None if one is unknown."""
    return None if first is None or second is None else 1 - (1 - first) * (1 - second)
