# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether it is known where in the map the robot is: the belief, read frame after frame."""

from collections import Counter
from dataclasses import replace
import math

from convseq_ros.config import Config
from convseq_ros.core.decision.observation import Neighbourhood
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Localization, LocalizationState, Match, Reason

# Of frames that say nothing about the place.
_SILENT = frozenset(
    {
        Reason.BETWEEN_KEYFRAMES, Reason.STATIONARY, Reason.UNINFORMATIVE, Reason.UNREADABLE,
        Reason.OUT_OF_ORDER,
    }
)  # fmt: skip
_SURE = frozenset({Reason.ACCEPTED, Reason.COOL_DOWN})


class Localizer:
    """
    Holds `lost`, `candidate` or `localised` over the matches of a drive.

    Localised is a robot whose place holds at least `min_confidence` of the belief, until that
    place and what is near it hold less than half; a place with a tenth is a candidate. In a map
    that grows only the places of earlier sessions count.
    """

    def __init__(self, reference_map: ReferenceMap) -> None:
        self._map, self._near = reference_map, Neighbourhood(reference_map)
        self.reset()

    def reset(self) -> None:
        self.localization = Localization(
            problem='too few frames: none that shows anything new was seen'
        )
        self._reasons: Counter[Reason] = Counter()  # since it was lost

    def update(self, match: Match, known: int, config: Config) -> Match:
        """Return a match with what is known after it of the first `known` places."""
        if match.reason not in _SILENT:
            self._reasons[match.reason] += 1
            self.localization = self._read(match, known, config.acceptance.min_confidence)
            if self.localization.state is LocalizationState.LOCALISED:
                self._reasons.clear()
        return replace(match, localization=self.localization)

    def _read(self, match: Match, known: int, least: float) -> Localization:
        place, quality = self._place(match, known), match.confidence
        mass = float(match.reason in _SURE) if quality is None else quality
        before = self.localization.reference_index
        was_localised = self.localization.state is LocalizationState.LOCALISED
        is_same = before is not None and place is not None and self._near.is_near(place, before)
        if was_localised:
            least = 0.5 if is_same else math.inf
        if place is not None and mass >= least:
            return Localization(LocalizationState.LOCALISED, quality, place)
        problem = self._problem(match)
        if place is not None and mass >= 0.1:
            return Localization(LocalizationState.CANDIDATE, quality, place, problem)
        return Localization(problem=problem)

    def _place(self, match: Match, known: int) -> int | None:
        """Return the best candidate, or the look of it that an earlier session saw."""
        if match.best is None:
            return None
        best = match.best.reference_index
        return next((one for one in (best, *self._map.links.looks(best)) if one < known), None)

    def _problem(self, match: Match) -> str:
        """Return why it is not localised."""
        if match.reason in (Reason.NO_MAP, Reason.RECENT):
            return 'there is no map: no place of an earlier session may be matched'
        if match.reason is Reason.AMBIGUOUS and len(match.candidates) > 1:
            first, rival, *_ = (one.reference_index for one in match.candidates)
            return f'ambiguous between place {first} and place {rival}'
        count = sum(self._reasons.values())
        if self._reasons[Reason.WARMING_UP] == count:
            return f'too few frames: {count} that show anything new, and more make a sequence'
        told = ', '.join(f'{number} {one}' for one, number in self._reasons.most_common())
        return f'nothing recognised in {count} keyframes ({told})'
