# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether the best candidate is a match, and how sure that is."""

from dataclasses import replace
import math

from convseq_ros.config import AcceptanceConfig, Config
from convseq_ros.core.decision.confidence import balance, Judgement
from convseq_ros.core.decision.geometry import Geometry
from convseq_ros.core.decision.likeliest import LIKELIEST
from convseq_ros.core.decision.margin import decide_by_margin
from convseq_ros.core.decision.neighbourhood import Compare, Neighbourhood
from convseq_ros.core.decision.track_evidence import FrameEvidence, TRACK, TrackEvidence
from convseq_ros.core.decision.verified_evidence import VERIFIED, VerifiedEvidence
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.sequence.diagonals import Rows
from convseq_ros.core.types import Candidates, Indices, Reason, Row


class Acceptance:
    """Decides frame after frame, by the track or by the margin."""

    def __init__(
        self,
        config: Config,
        reference_map: ReferenceMap | None = None,
        compare: Compare | None = None,
    ) -> None:
        self.places = Neighbourhood(reference_map, compare)
        rule, matching = config.acceptance.acceptance_rule, config.matching.matching
        self.by_track = rule == 'track' or (rule == 'auto' and matching == 'coherent')
        self.window = TRACK.window if self.by_track else 1  # newest frames that must have scores
        self.verifies = self.by_track and config.acceptance.verification
        self.reset()

    def reset(self) -> None:
        """Forget the drive."""
        self.places.reset()
        self._track, self._verified = TrackEvidence(self.places), VerifiedEvidence(self.places)
        self._frame, self._velocity, self._steady, self._usable = 0, 1.0, TRACK.window, 0
        self._newest: FrameEvidence | None = None
        self._geometry: Geometry | None = None
        self._session_start: int | None = None
        self._row: Row | None = None
        self.entered: tuple[int, float] | None = None  # place, evidence; by few frames alone

    def update(
        self,
        frame: int,
        rows: Rows,
        ends: Indices,
        rival_distance: int,
        velocity: float = 1.0,
        geometry: Geometry | None = None,
        session_start: int | None = None,
    ) -> None:
        """
        Take in a frame; as `TrackEvidence.update`; a few likely places are verified.

        References from `session_start` on were seen on this drive.
        """
        self._steady = self._steady + 1 if velocity == self._velocity else 0  # frames
        self._frame, self._velocity, self._session_start = frame, velocity, session_start
        self.entered = None
        if not self.by_track:
            return
        self._row = row = rows[0]
        self._newest = self._track.update(frame, rows, ends, rival_distance, velocity)
        self._verified.update({}, rival_distance)
        if self._newest is None or geometry is None or row is None:
            return
        self._geometry, self._usable = geometry, len(row)
        if not (found := geometry.verified(self._track.likely())):
            return
        self._verified.update(found, rival_distance)
        self._track.verify(self._verified.beside_scores(self._newest.reference))
        likeliest = max(found, key=lambda index: float(row[index]) * found[index].strength)
        self._verified.see(frame, likeliest, self._track.lead(likeliest))
        self.entered = self._entered()

    def surest(self) -> tuple[int, float] | None:
        """
        Return the place that speaks most for itself, along a track and alone, and the evidence.

        Sequences of many frames find a place late that has just been entered.
        """
        places = [self.entered[0]] if self.entered else []
        places += [self._newest.reference] if self._newest else []
        told = ((one, self._evidence(one)) for one in places)
        known = ((one, evidence) for one, evidence in told if evidence is not None)
        return max(known, key=lambda one: one[1], default=None)

    def _evidence(self, reference: int) -> float | None:
        """
        Return all that speaks for a place, if anything is known; a track that is followed.

        What the newest frames say alone is added to the track of the map's own velocity, which
        they follow. For a place of this very drive the larger counts: camera and light are the
        same, and another locker misleads both alike.
        """
        entered, newest = self.entered, self._newest
        alone = entered[1] if entered and self._is_near(reference, entered[0]) else None
        # A track that its own newest frame does not follow is none.
        if newest is None or not self._is_near(reference, newest.reference):
            return alone
        along = self._along(reference)
        if along is None or not alone:
            return alone if along is None else along
        if self._is_own(reference):
            return max(along, alone)
        own = self._track.evidence(self._frame, reference, self._direction)
        return max(along, alone + (own or 0.0))

    @property
    def _direction(self) -> float:
        """The map's own velocity, negative on a drive that meets its places in reverse order."""
        return math.copysign(1.0, self._velocity)

    @property
    def seen_velocity(self) -> float | None:
        """How fast the likeliest places move along the map, while no track is followed."""
        known = self._along(self._newest.reference) if self._newest else None
        return None if (known or 0.0) >= LIKELIEST.track else self._verified.likeliest.velocity

    def _is_near(self, reference: int, other: int) -> bool:
        """Return whether two places may belong to one track, or to its looks."""
        return self.places.is_near(reference, other, TRACK.same_track)

    def _is_own(self, reference: int) -> bool:
        """Return whether a place was seen on this drive."""
        return self._session_start is not None and reference >= self._session_start

    def _entered(self) -> tuple[int, float] | None:
        seen = self._verified.likeliest.alone(self._frame, self._direction)
        if seen is None:
            return None
        reference, evidence = seen
        first, end = self.places.bounds.span(reference)
        end = min(end, self._usable)
        before, after = (0, TRACK.border) if self._direction > 0 else (TRACK.border - 1, 1)
        if not first + before < reference < end - after:
            return None
        return reference, evidence * (VERIFIED.of_own_drive if self._is_own(reference) else 1.0)

    def _along(self, reference: int) -> float | None:
        """Return the evidence along a track; none at another velocity that geometry denies."""
        evidence = self._track.evidence(self._frame, reference, self._velocity)
        if evidence is not None and self._velocity != 1.0 and self._verified.denies(reference):
            return min(evidence, 0.0)
        return evidence

    def placed(self, best: int, least: float) -> int:
        """
        Return the place that a match belongs to: the best, or one beside it.

        A track of so much evidence, at the map's velocity for half a window, says where it
        ends. Any other may end beside the place that the newest frame shows.
        """
        is_steady = self._velocity == 1.0 and 2 * self._steady >= TRACK.window
        if (is_steady and (self._along(best) or 0.0) >= least) or self._geometry is None:
            return best
        return self._verified.placed(best, self._geometry, self._velocity)

    def newest_score(self, reference: int) -> float:
        """Return the pair score of the newest frame with a likely place."""
        return 0.0 if self._row is None else max(0.0, float(self._row[reference]))

    def inliers(self, reference: int) -> int | None:
        """Return how many regions moved alike to a reference, or one next to it, if verified."""
        near, known = self.places.bounds.around(reference, 1), self._verified.found
        found = [known[one] for one in (reference, *near) if one in known]
        return found[0].inliers if found else None

    @property
    def strengths(self) -> dict[int, float]:
        """How strongly likely places of the newest frame are verified."""
        return {one: shown.strength for one, shown in self._verified.found.items()}

    def is_settled(self, reference: int) -> bool:
        """Return whether the newest frame shows no place further along the way better."""
        return self._geometry is None or self._verified.is_settled(reference, self._geometry)

    def judge(self, candidates: Candidates, config: AcceptanceConfig) -> Judgement:
        """Return whether the best of at least one candidate of the newest frame is a match."""
        said, best = self._decide(candidates, config), candidates[0].reference_index
        if said.reason is Reason.ACCEPTED and self._is_unlike_own_drive(best):
            return replace(said, reason=Reason.UNVERIFIED)
        return said

    def _decide(self, candidates: Candidates, config: AcceptanceConfig) -> Judgement:
        if not self.by_track:
            return Judgement(decide_by_margin(candidates, config, self.places))
        best = candidates[0].reference_index
        reason, evidence = self._doubt(best), self._evidence(best)
        if evidence is not None and evidence >= config.min_evidence:
            reason = Reason.ACCEPTED
        if not (known := [one for one in (self._along(best), evidence) if one is not None]):
            return Judgement(reason)
        share = self._track.share(self._frame, best, self._velocity)
        return Judgement(reason, max(known), share, balance(self._verified.shown(best)))

    def _doubt(self, best: int) -> Reason:
        """Return what speaks most against a candidate."""
        if (newest := self._newest) is None:
            return Reason.WEAK
        if not self._is_near(best, newest.reference):
            return Reason.INCONSISTENT
        if not newest.enough_rivals:
            return Reason.TOO_FEW_RIVALS
        is_small = newest.margin < (self._track.scatter or 0.0)
        return Reason.AMBIGUOUS if is_small or self._verified.is_rivalled(best) else Reason.WEAK

    def _is_unlike_own_drive(self, best: int) -> bool:
        """Return whether a place is verified too badly to be one that this drive has shown."""
        if not self._is_own(best):
            return False
        own = self._verified.recent_strength(self._frame, best, self._direction)
        step = self._geometry.verified_step if self._geometry and own is not None else None
        return own is not None and step is not None and own < VERIFIED.of_step * step.strength
