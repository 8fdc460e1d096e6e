# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether it is known where in the map the robot is, frame after frame."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

from convseq_ros.config import Config
from convseq_ros.core.decision.acceptance import Acceptance
from convseq_ros.core.decision.verified_evidence import VERIFIED
from convseq_ros.core.map.place import Place
from convseq_ros.core.sighting import SIGHTING, Sighting, Sightings
from convseq_ros.core.types import Localization, LocalizationState, Match, Pose, Reason

# Of frames that say nothing about the place.
_SILENT = frozenset(
    {
        Reason.BETWEEN_KEYFRAMES, Reason.STATIONARY, Reason.UNINFORMATIVE, Reason.UNREADABLE,
        Reason.OUT_OF_ORDER,
    }
)  # fmt: skip


class Localizer:
    """
    Holds `lost`, `candidate` or `localised` over the matches of a drive.

    A sure match is a candidate, and so is a place for which the newest few frames alone speak with
    .6 of a match's evidence; `localize_keyframes` that agree make it localised, one more where a
    place further along the way is verified better, and after it was lost only if the last is sure.
    It stays so while nothing speaks against it. `lost_keyframes` that show another place, or the
    same no better than another, make it lost, unless a match of about the usual strength comes
    between them, and so do `localize_keyframes` that agree on another one. In a map that grows
    only the places of earlier sessions count.
    """

    def __init__(
        self, places: Sequence[Place], config: Config, acceptance: Acceptance | None = None
    ) -> None:
        self._config, self._sightings = config.localization, Sightings(places, acceptance)
        self.reset()

    def reset(self) -> None:
        """Forget the drive."""
        self._sightings.reset()
        self._against = 0
        self._home: Sighting | None = None  # where it is localised
        self._usual = 0.0  # strength of its verification
        self._lost_at = 0  # keyframe at which it was lost
        self._reasons: Counter[Reason] = Counter()  # since it was lost
        self._last: Match | None = None

    def update(self, match: Match, odometry: Pose | None, known: int, config: Config) -> Match:
        """
        Return a match with what is known after it.

        `odometry` tells where the frame was taken; the first `known` places are of earlier
        sessions.
        """
        if match.reason not in _SILENT:
            self._last = match
            self._reasons[match.reason] += 1
            is_lost = self._lost_at > 0 and self._home is None
            seen = self._sightings.update(match, odometry, known, config, is_lost)
            if self._home:
                self._keep_or_lose(self._home, match, seen, odometry)
            elif seen and (seen.is_sure or not is_lost) and self._is_enough(seen):
                self._home, self._usual = seen, self._sightings.strengths(seen, odometry)[0]
        return replace(match, localization=self.localization)

    @property
    def localization(self) -> Localization:
        """What is known now."""
        if home := self._home:
            doubt = self._against / self._config.lost_keyframes
            sure = None if home.quality is None else home.quality * (1 - doubt)
            return Localization(LocalizationState.LOCALISED, sure, home.reference)
        seen, problem = self._recent(), self._problem()
        if seen and self._sightings.keyframes > self._lost_at:
            return Localization(LocalizationState.CANDIDATE, seen.quality, seen.reference, problem)
        return Localization(problem=problem)

    def _keep_or_lose(
        self, home: Sighting, match: Match, seen: Sighting | None, odometry: Pose | None
    ) -> None:
        agree, best = self._sightings.agree, match.best
        here, away = self._sightings.strengths(home, odometry)
        is_alike = away >= VERIFIED.as_good * here
        if seen and agree(home, seen.reference, odometry):
            self._home, seen = seen, None
            if not is_alike or here >= SIGHTING.weak * self._usual:
                self._against = 0
                self._usual += (1 - SIGHTING.memory) * (here - self._usual)
                return
        is_elsewhere = best is not None and not agree(home, best.reference_index, odometry)
        self._against += is_elsewhere or is_alike or match.reason is Reason.INCONSISTENT
        if (
            self._against >= self._config.lost_keyframes
            or (seen and seen.agreeing >= self._config.localize_keyframes)
            or self._sightings.keyframes - home.keyframe >= SIGHTING.silent_keyframes
        ):
            self._home, self._against, self._lost_at = None, 0, self._sightings.keyframes
            # What agreed with the old place so far counts no longer.
            self._sightings.last = seen
            self._reasons.clear()

    def _is_enough(self, seen: Sighting) -> bool:
        beyond = seen.agreeing - self._config.localize_keyframes
        return beyond > 0 or (beyond == 0 and self._sightings.is_settled(seen))

    def _recent(self) -> Sighting | None:
        """Return what was seen last, if that is not long ago."""
        seen = self._sightings.last
        if seen and self._sightings.keyframes - seen.keyframe < self._config.lost_keyframes:
            return seen
        return None

    def _problem(self) -> str:
        """Return why it is not localised."""
        last = self._last
        if last is None:
            return 'too few frames: none that shows anything new was seen'
        if last.reason in (Reason.NO_MAP, Reason.RECENT):
            return 'there is no map: no place of an earlier session may be matched'
        if last.reason is Reason.AMBIGUOUS and len(last.candidates) > 1:
            first, rival = last.candidates[0].reference_index, self._sightings.rival(last)
            return f'ambiguous between place {first} and place {rival}'
        if seen := self._recent():
            count, least = seen.agreeing, self._config.localize_keyframes
            told = f'too few frames: {count} of {least} matches agree on place {seen.reference}'
            beside = 'places beside it look as likely'
            return told if count < least else f'{told}, but {beside}'
        count = sum(self._reasons.values())
        if self._reasons[Reason.WARMING_UP] == count:
            return f'too few frames: {count} that show anything new, and more make a sequence'
        told = ', '.join(f'{number} {one}' for one, number in self._reasons.most_common())
        return f'nothing recognised in {count} keyframes ({told})'
