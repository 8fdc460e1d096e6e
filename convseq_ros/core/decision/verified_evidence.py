# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What geometry adds to the evidence: how much better a place is verified than any other.

A few likely places of each frame are verified. Beside the scores of a track counts by how much its
place is verified better than its rivals; and a few newest frames, or one, that stand out both by
their own scores and by geometry are evidence alone, as soon as they come.
"""

from collections.abc import Mapping
import math

from convseq_ros.core.constants import constants
from convseq_ros.core.decision.geometry import Geometry
from convseq_ros.core.decision.likeliest import Likeliest, LikeliestPlaces
from convseq_ros.core.decision.neighbourhood import Neighbourhood
from convseq_ros.core.decision.track_evidence import TRACK
from convseq_ros.core.geometry.verification import NOTHING, Verification
import numpy as np


@constants
class VERIFIED:
    """Chosen on drawn drives and on real images made dark (docs/GEOMETRY.md)."""

    least_strength: float = 30.0  # of unrelated images, in the middle of all sets
    # A lead by geometry, the square root of a strength, counts for so many scatters of a track ...
    scatters: float = 0.36
    chance: float = 0.5  # ... less these, by which a rival may well be verified worse
    deviations: float = 0.73  # and for so many standard deviations of a frame's own scores
    # What lies on the ground repeats: zebra crossings, tiles. So evidence alone is no more than so
    # many times what the lead by the upper half of the image says.
    of_upper: float = 3.0
    beside: int = 3  # places from a match; the best scored of them is where it belongs ...
    better: float = 1.2  # ... if verified so many times as strongly (scripts/spacing.py)
    # Of what frames say alone, what counts for a place of the same drive: identical lockers reach
    # 33 deviations.
    of_own_drive: float = 0.54
    as_good: float = 0.8  # of the best place's strength, with which a rival makes it ambiguous
    # Of the strength between a frame and the one before, that a place of the same drive has at
    # least: there, camera and light are the same. Identical lockers have a third.
    of_step: float = 0.4


class VerifiedEvidence:
    """Keeps what geometry says of the newest frame, and the likeliest places of the last ones."""

    def __init__(self, neighbourhood: Neighbourhood | None = None) -> None:
        self._places = neighbourhood or Neighbourhood()
        self.likeliest = LikeliestPlaces(self._places)
        self.found: Mapping[int, Verification] = {}
        self._rival_distance = 0

    def update(self, found: Mapping[int, Verification], rival_distance: int) -> None:
        """Take in what geometry says of the newest frame and its likely places."""
        self.found, self._rival_distance = found, rival_distance

    def strength(self, reference: int, distance: int = 0) -> float | None:
        """Return how strongly a place, or the best within a distance, is verified, if it is."""
        near = [one.strength for one in self._near(reference, distance)]
        return max(near, default=None)

    def _near(self, reference: int, distance: int) -> list[Verification]:
        is_near = self._places.is_near
        return [one for index, one in self.found.items() if is_near(reference, index, distance)]

    def rivals(self, reference: int) -> list[Verification]:
        """Return how places elsewhere are verified."""
        is_near, most = self._places.is_near, self._rival_distance
        found = self.found.items()
        return [one for index, one in found if not is_near(reference, index, most)]

    def rival_strength(self, reference: int) -> float | None:
        """Return how strongly the best place elsewhere is verified, if any is."""
        return max((one.strength for one in self.rivals(reference)), default=None)

    def is_rivalled(self, reference: int) -> bool:
        """Return whether a place elsewhere is verified nearly as well."""
        own, rival = self.strength(reference, TRACK.same_track), self.rival_strength(reference)
        return own is not None and rival is not None and rival >= VERIFIED.as_good * own

    def lead(self, reference: int) -> float | None:
        """
        Return by how much a place is verified better than any other, if both are verified.

        As strengths are much like counts, in square roots of the rival's.
        """
        own = self.strength(reference, TRACK.same_track)
        rival = self.rival_strength(reference)
        if own is None or rival is None:
            return None
        return (own - rival) / math.sqrt(max(rival, VERIFIED.least_strength))

    def upper_lead(self, reference: int) -> float:
        """Return the same by the upper half of the image alone; 0 if nothing else is verified."""
        near = [one.upper for one in self._near(reference, TRACK.same_track)]
        if not near or not (rivals := self.rivals(reference)):
            return 0.0
        rival = max(one.upper for one in rivals)
        return (max(near) - rival) / math.sqrt(max(rival, VERIFIED.least_strength / 2))

    def shown(self, reference: int) -> Verification:
        """Return how a place, or the best beside it, is verified; `NOTHING` if it is not."""
        near = self._near(reference, TRACK.same_track)
        return max(near, key=lambda one: one.strength, default=NOTHING)

    def placed(self, best: int, geometry: Geometry, velocity: float = 1.0) -> int:
        """
        Return the place that the newest frame shows: the best, or one beside it.

        At another velocity than the map's a sequence ends as many more beside it as it is faster,
        and what is verified better at all is the place.
        """
        reach = math.ceil(VERIFIED.beside * max(1.0, abs(velocity)))
        better = VERIFIED.better if abs(velocity) == 1.0 else 1.0
        around = self._places.bounds.around(best, reach)
        geometry.score(1, np.array(around))
        scores = () if geometry.row is None else geometry.row
        near = [one for one in around if one != best and one < len(scores) and scores[one] >= 0]
        if not near:
            return best
        beside = max(near, key=lambda one: float(scores[one]))
        unknown = [one for one in (best, beside) if one not in self.found]
        self.found = {**self.found, **geometry.verified(unknown)}
        own, other = (_support(self.found.get(one, NOTHING)) for one in (best, beside))
        return beside if other > better * own else best

    def is_settled(self, reference: int, geometry: Geometry) -> bool:
        """Return whether no place is verified better that is further along its peak."""
        around = self._places.bounds.around(reference, TRACK.own_peak)
        asked = [one for one in around if geometry.row is not None and one < len(geometry.row)]
        found = {one: shown.strength for one, shown in geometry.verified(asked).items()}
        near = [found.pop(one) for one in list(found) if abs(one - reference) <= TRACK.same_track]
        return max(found.values(), default=0.0) <= max(near, default=0.0)

    def beside_scores(self, reference: int) -> float:
        """Return what geometry adds to a frame's margin, in scatters of the track."""
        lead, upper = self.lead(reference), self.upper_lead(reference)
        if lead is None:
            return 0.0
        least = min(lead, VERIFIED.of_upper * upper)
        return max(0.0, VERIFIED.scatters * least - VERIFIED.chance)

    def denies(self, reference: int) -> bool:
        """Return whether a place is verified no better than a rival may be by chance."""
        is_near = self._places.is_near
        near = [one for one in self.found if is_near(reference, one, TRACK.same_track)]
        return bool(near) and not any(self.beside_scores(one) > 0 for one in near)

    def see(self, frame: int, reference: int, deviations: float) -> None:
        """Take in the newest frame's likeliest place, and by how much its score stands out."""
        strength, evidence = self.strength(reference) or 0.0, 0.0
        if (lead := self.lead(reference)) is not None:
            whole = deviations + VERIFIED.deviations * lead
            most = VERIFIED.of_upper * VERIFIED.deviations * self.upper_lead(reference)
            evidence = max(0.0, min(whole, most))
        self.likeliest.add(Likeliest(frame, reference, evidence, strength))

    def recent_strength(self, frame: int, reference: int, direction: float = 1.0) -> float | None:
        """Return how strongly a place is verified by the newest frames, on average, if it is."""
        recent = self.likeliest.recent_strength(frame, reference, direction)
        return self.strength(reference, TRACK.same_track) if recent is None else recent


def _support(found: Verification) -> float:
    """Return how strongly a place is verified; by what lies on the ground alone, hardly."""
    return min(found.strength, VERIFIED.of_upper * found.upper)
