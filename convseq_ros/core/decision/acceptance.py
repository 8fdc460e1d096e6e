# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The best few places among all scores, whether the best is a match, and how sure that is."""

from collections.abc import Sequence
import math

from convseq_ros.config import AcceptanceConfig, Config
from convseq_ros.core.constants import constants
from convseq_ros.core.decision.track_evidence import FrameEvidence, TRACK, TrackEvidence
from convseq_ros.core.map.place import Place
from convseq_ros.core.sequence.diagonals import diagonal, Rows, Values
from convseq_ros.core.types import Candidate, Indices, Reason
import numpy as np

Candidates = Sequence[Candidate]
Judgement = tuple[Reason, float | None]  # and the probability that the best is right, if known


@constants
class CONFIDENCE:
    """Between what fits drawn streets that repeat, and dark images (scripts/fit_acceptance.py)."""

    offset: float = -0.2  # of a logistic function: log odds at an evidence of 1
    slope: float = 2.1  # log odds per e-fold
    least_evidence: float = 0.1  # added, so that none has a logarithm


class Acceptance:
    """Decides frame after frame, by the track or by the margin; keeps matches apart in time."""

    def __init__(self, config: Config) -> None:
        rule, matching = config.acceptance.acceptance_rule, config.matching.matching
        self._by_track = rule == 'track' or (rule == 'auto' and matching == 'coherent')
        self.window = TRACK.window if self._by_track else 1  # newest frames that must have scores
        self.reset()

    def reset(self) -> None:
        """Forget the drive."""
        self._accepted_ns: int | None = None
        self._track, self._frame, self._velocity = TrackEvidence(), 0, 1.0
        self._newest: FrameEvidence | None = None

    def update(
        self, frame: int, rows: Rows, ends: Indices, rival_distance: int, velocity: float = 1.0
    ) -> None:
        """Take in a frame; as `TrackEvidence.update`."""
        self._frame, self._velocity = frame, velocity
        if self._by_track:
            self._newest = self._track.update(frame, rows, ends, rival_distance, velocity)

    def judge(self, stamp_ns: int, candidates: Candidates, config: AcceptanceConfig) -> Judgement:
        """Return whether the best of at least one candidate of the newest frame is a match."""
        reason, sure = self._decide(candidates, config)
        if reason is Reason.ACCEPTED:
            interval_ns = round(config.closure_interval_s * 1e9)
            if self._accepted_ns is not None and stamp_ns - self._accepted_ns < interval_ns:
                return Reason.COOL_DOWN, sure
            self._accepted_ns = stamp_ns
        return reason, sure

    def _decide(self, candidates: Candidates, config: AcceptanceConfig) -> Judgement:
        if not self._by_track:
            return decide_by_margin(candidates, config), None
        best = candidates[0].reference_index
        reason = self._doubt(best)
        if (evidence := self._track.evidence(self._frame, best, self._velocity)) is None:
            return reason, None
        if reason is not Reason.INCONSISTENT and evidence >= config.min_evidence:
            reason = Reason.ACCEPTED
        return reason, confidence(evidence)

    def _doubt(self, best: int) -> Reason:
        """Return what speaks most against a candidate."""
        if (newest := self._newest) is None:
            return Reason.WEAK
        if abs(newest.reference - best) > TRACK.same_track:
            return Reason.INCONSISTENT
        if not newest.enough_rivals:
            return Reason.TOO_FEW_RIVALS
        return Reason.AMBIGUOUS if newest.margin < (self._track.scatter or 0.0) else Reason.WEAK


def decide_by_margin(candidates: Candidates, config: AcceptanceConfig) -> Reason:
    """Decide by the lead over the best rival: scores of unrelated places lie near true ones."""
    if len(candidates) < 2:
        return Reason.TOO_FEW_RIVALS
    lead = candidates[0].score - candidates[1].score
    return Reason.ACCEPTED if lead >= config.min_margin else Reason.AMBIGUOUS


def confidence(evidence: float) -> float:
    """Return the probability that a candidate is right, in [0, 1], given its track evidence."""
    strength = math.log(max(evidence, 0.0) + CONFIDENCE.least_evidence)
    return 1.0 / (1.0 + math.exp(-CONFIDENCE.offset - CONFIDENCE.slope * strength))


def best_candidates(
    ends: Indices, scores: Values, places: Sequence[Place], config: AcceptanceConfig
) -> tuple[Candidate, ...]:
    """Return the best places, best first, no neighbours; of scores (n,) at `ends`, or -inf."""
    remaining = scores.copy()
    found: list[Candidate] = []
    while len(found) < config.num_candidates and np.isfinite(remaining).any():
        top = int(remaining.argmax())
        index = int(ends[top])
        found.append(Candidate(index, places[index].stamp_ns, float(scores[top])))
        remaining[abs(ends - index) <= config.rival_distance] = -np.inf
    return tuple(found)


def why_none(usable: int, length: int, velocity: float) -> Reason:
    """Return why no sequence of so many frames has a score, with so many usable references."""
    short = usable <= diagonal(length, velocity)[-1]
    return Reason.MAP_TOO_SHORT if short else Reason.WARMING_UP
