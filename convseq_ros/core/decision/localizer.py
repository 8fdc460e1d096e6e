# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The localization state: whether the robot's place in the map is known, frame by frame."""

from collections import Counter
from dataclasses import replace

from convseq_ros.core.graph.neighbourhood import Neighbourhood
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import (
    constants,
    Localization,
    LocalizationState,
    Match,
    Reason,
    RECOGNISED,
)

# Reasons of frames without information about the place.
_SILENT = frozenset(
    {
        Reason.BETWEEN_KEYFRAMES, Reason.STATIONARY, Reason.UNINFORMATIVE, Reason.UNREADABLE,
        Reason.OUT_OF_ORDER,
    }
)  # fmt: skip


@constants
class LOCALISED:
    """Least probabilities of the robot's place; engineering."""

    stays: float = 0.5  # of a localised robot, near its last place
    candidate: float = 0.1


class Localizer:
    """
    Keeps the state of a drive: `lost`, `candidate` or `localised`.

    The robot is localised once a match is accepted. It stays localised while that place, or one
    near it, has a probability of at least 50 %. A place with at least 10 % is a candidate. In a
    map that grows, only places of earlier sessions count.
    """

    def __init__(self, reference_map: ReferenceMap) -> None:
        self._map, self._near = reference_map, Neighbourhood(reference_map)
        self.reset()

    def reset(self) -> None:
        self.localization = Localization(
            problem='no keyframe yet: move the robot, so that the image changes'
        )
        self._reasons: Counter[Reason] = Counter()  # of the frames since the robot was lost

    def update(self, match: Match, usable: int) -> Match:
        """Return a match with the localization after it, among the first `usable` places."""
        if match.reason not in _SILENT:
            self._reasons[match.reason] += 1
            self.localization = self._localize(match, usable)
            if self.localization.state is LocalizationState.LOCALISED:
                self._reasons.clear()
        return replace(match, localization=self.localization)

    def _localize(self, match: Match, usable: int) -> Localization:
        place, quality = self._place(match, usable), match.confidence
        is_accepted = match.reason in RECOGNISED
        mass = float(is_accepted) if quality is None else quality
        before = self.localization.reference_index
        if self.localization.state is not LocalizationState.LOCALISED:
            is_known = is_accepted
        else:
            is_same = (
                before is not None and place is not None and self._near.is_near(place, before)
            )
            is_known = is_same and mass >= LOCALISED.stays
        if place is not None and is_known:
            return Localization(LocalizationState.LOCALISED, quality, place)
        problem = self._problem(match)
        if place is not None and mass >= LOCALISED.candidate:
            return Localization(LocalizationState.CANDIDATE, quality, place, problem)
        return Localization(problem=problem)

    def _place(self, match: Match, usable: int) -> int | None:
        """Return the best candidate, or an earlier session's keyframe of the same place."""
        if match.best is None:
            return None
        best = match.best.reference_index
        return next((look for look in (best, *self._map.links.looks(best)) if look < usable), None)

    def _problem(self, match: Match) -> str:
        """Return why the robot is not localised."""
        if match.reason in (Reason.NO_MAP, Reason.RECENT):
            return 'there is no map: no place of an earlier session may be matched'
        if match.reason is Reason.AMBIGUOUS and len(match.candidates) > 1:
            first, rival, *_ = (candidate.reference_index for candidate in match.candidates)
            return f'ambiguous between place {first} and place {rival}'
        count = sum(self._reasons.values())
        if self._reasons[Reason.WARMING_UP] == count:
            return f'too few frames: {count} that show anything new, and more make a sequence'
        counts = ', '.join(f'{number} {reason}' for reason, number in self._reasons.most_common())
        return f'nothing recognised in {count} keyframes ({counts})'
