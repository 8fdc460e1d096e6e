# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether the best candidate is a match, why or why not, and how sure that is."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

from convseq_ros.config import AcceptanceConfig, Config
from convseq_ros.core.decision.track_evidence import FrameEvidence, TRACK, TrackEvidence
from convseq_ros.core.sequence.diagonals import Indices, Rows
from convseq_ros.core.types import Candidate, Reason

Verdict = tuple[Reason, float | None]


@dataclass(frozen=True, slots=True)
class ConfidenceConstants:
    """
    Of the logistic function of the logarithm of the evidence.

    Between those that fit drawn streets some of whose buildings repeat, which say less, and real
    images made dark, which say more (scripts/fit_acceptance.py).
    """

    offset: float = -0.2  # log odds at an evidence of 1
    slope: float = 2.1  # log odds per e-fold
    least_evidence: float = 0.1  # added, so that none has a logarithm


CONFIDENCE = ConfidenceConstants()


class MarginRule:
    """Decides by the newest sequence alone: how far the best candidate leads its best rival."""

    window = 1  # frames whose scores are wanted

    def reset(self) -> None: ...

    def update(
        self, frame: int, rows: Rows, ends: Indices, rival_distance: int, velocity: float
    ) -> None: ...

    def decide(
        self, _frame: int, candidates: Sequence[Candidate], config: AcceptanceConfig, _v: float
    ) -> Verdict:
        """Return the reason and the confidence, if the rule tells; as `Acceptance.judge`."""
        return decide_by_margin(candidates, config), None


class TrackRule(MarginRule):
    """Decides by what the last frames together say for the best candidate."""

    window = TRACK.window

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the drive."""
        self._track = TrackEvidence()
        self._newest: FrameEvidence | None = None

    def update(
        self, frame: int, rows: Rows, ends: Indices, rival_distance: int, velocity: float
    ) -> None:
        """Take in a frame; as `TrackEvidence.update`."""
        self._newest = self._track.update(frame, rows, ends, rival_distance, velocity)

    def decide(
        self, frame: int, candidates: Sequence[Candidate], config: AcceptanceConfig, v: float
    ) -> Verdict:
        """Return the reason and the confidence; as `Acceptance.judge`."""
        best = candidates[0].reference_index
        evidence = self._track.evidence(frame, best, v)
        reason = self._doubt(best)
        if evidence is None:
            return reason, None
        if reason is not Reason.INCONSISTENT and evidence >= config.min_evidence:
            reason = Reason.ACCEPTED
        return reason, confidence(evidence)

    def _doubt(self, best: int) -> Reason:
        """Return what speaks most against a candidate."""
        newest = self._newest
        if newest is None:
            return Reason.WEAK
        if abs(newest.reference - best) > TRACK.same_track:
            return Reason.INCONSISTENT
        if not newest.enough_rivals:
            return Reason.TOO_FEW_RIVALS
        is_close = newest.margin < (self._track.scatter or 0.0)
        return Reason.AMBIGUOUS if is_close else Reason.WEAK


class Acceptance:
    """Decides frame after frame, by one of two rules, and keeps matches apart in time."""

    def __init__(self, config: Config) -> None:
        rule, matching = config.acceptance.acceptance_rule, config.matching.matching
        by_track = rule == 'track' or (rule == 'auto' and matching == 'coherent')
        self._rule = TrackRule() if by_track else MarginRule()
        self._accepted_ns: int | None = None

    @property
    def window(self) -> int:
        """The frames before and with the newest whose scores are wanted."""
        return self._rule.window

    def reset(self) -> None:
        """Forget the drive."""
        self._accepted_ns = None
        self._rule.reset()

    def update(
        self, frame: int, rows: Rows, ends: Indices, rival_distance: int, velocity: float = 1.0
    ) -> None:
        """Take in a frame; as `TrackEvidence.update`."""
        self._rule.update(frame, rows, ends, rival_distance, velocity)

    def judge(
        self,
        frame: int,
        stamp_ns: int,
        candidates: Sequence[Candidate],
        config: AcceptanceConfig,
        velocity: float = 1.0,
    ) -> Verdict:
        """
        Decide on the best of at least one candidate of the newest frame.

        Return whether it is accepted or why not, and the probability that it is right, if the rule
        tells. Frames are numbered; those that show nothing are counted.
        """
        reason, sure = self._rule.decide(frame, candidates, config, velocity)
        if reason is Reason.ACCEPTED:
            interval_ns = round(config.closure_interval_s * 1e9)
            if self._accepted_ns is not None and stamp_ns - self._accepted_ns < interval_ns:
                return Reason.COOL_DOWN, sure
            self._accepted_ns = stamp_ns
        return reason, sure


def decide_by_margin(candidates: Sequence[Candidate], config: AcceptanceConfig) -> Reason:
    """
    Decide by the margin between the best of at least one candidate and its best rival.

    The paper always answers with the best one. Scores of unrelated places lie too near those of
    true ones for an absolute threshold, so the margin decides.
    """
    if len(candidates) < 2:
        return Reason.TOO_FEW_RIVALS
    margin = candidates[0].score - candidates[1].score
    return Reason.ACCEPTED if margin >= config.min_margin else Reason.AMBIGUOUS


def confidence(evidence: float) -> float:
    """Return the probability that a candidate is right, in [0, 1], given its track evidence."""
    strength = math.log(max(evidence, 0.0) + CONFIDENCE.least_evidence)
    return 1.0 / (1.0 + math.exp(-CONFIDENCE.offset - CONFIDENCE.slope * strength))
