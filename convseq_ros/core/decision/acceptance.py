# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether the best candidate is a match, why or why not, and how sure that is."""

from collections.abc import Sequence
import math

from convseq_ros.config import AcceptanceConfig
from convseq_ros.core.decision.track_evidence import (
    Indices,
    SAME_TRACK,
    Sight,
    TrackEvidence,
    WINDOW,
)
from convseq_ros.core.sequence.diagonals import Row
from convseq_ros.core.types import Candidate, Reason

Verdict = tuple[Reason, float | None]

_CONFIDENCE = (-0.2, 2.1)
_LEAST_EVIDENCE = 0.1


class Acceptance:
    """
    Decides frame after frame, by one of two rules.

    Parameters
    ----------
    matching : str
        How pairs are scored. `acceptance_rule: auto` takes the track for coherent scores and the
        margin for regional ones.
    rule : str
        auto, margin or track.

    """

    def __init__(self, matching: str, rule: str = 'auto') -> None:
        by_track = rule == 'track' or (rule == 'auto' and matching == 'coherent')
        self._track = TrackEvidence() if by_track else None
        self._accepted_ns: int | None = None
        self._sight: Sight | None = None

    @property
    def window(self) -> int:
        """The frames before and with the newest whose scores are wanted."""
        return WINDOW if self._track else 1

    def reset(self) -> None:
        """Forget the drive."""
        self._accepted_ns = None
        if self._track:
            self._track = TrackEvidence()

    def follow(
        self, frame: int, rows: Sequence[Row | None], ends: Indices, slope: float = 1.0
    ) -> None:
        """Take note of a frame; as `TrackEvidence.follow`."""
        self._sight = self._track.follow(frame, rows, ends, slope) if self._track else None

    def judge(
        self,
        frame: int,
        stamp_ns: int,
        candidates: Sequence[Candidate],
        config: AcceptanceConfig,
        slope: float = 1.0,
    ) -> Verdict:
        """
        Decide on the best candidate of the frame that was followed last.

        Parameters
        ----------
        frame : int
            Its number in the drive; frames that show nothing are passed over but counted.
        stamp_ns : int
            When it was taken, nanoseconds.
        candidates : sequence of Candidate
            At least one, best first, neighbours left out.
        config : AcceptanceConfig
            The least margin and evidence, and the time between two matches.
        slope : float
            References that pass while one frame does.

        Returns
        -------
        reason : Reason
            Accepted or why not.
        confidence : float or None
            Probability that the best candidate is right, if the rule tells.

        """
        if self._track:
            reason, sure = self._by_track(self._track, frame, candidates[0], config, slope)
        else:
            reason, sure = decide(candidates, config), None
        if reason is Reason.ACCEPTED:
            interval_ns = round(config.closure_interval_s * 1e9)
            if self._accepted_ns is not None and stamp_ns - self._accepted_ns < interval_ns:
                return Reason.COOL_DOWN, sure
            self._accepted_ns = stamp_ns
        return reason, sure

    def _by_track(
        self,
        track: TrackEvidence,
        frame: int,
        candidate: Candidate,
        config: AcceptanceConfig,
        slope: float,
    ) -> Verdict:
        best = candidate.reference_index
        evidence = track.evidence(frame, best, slope)
        reason = _doubt(self._sight, best, track.scatter)
        if evidence is None:
            return reason, None
        if reason is not Reason.INCONSISTENT and evidence >= config.min_evidence:
            reason = Reason.ACCEPTED
        return reason, confidence(evidence)


def _doubt(sight: Sight | None, best: int, scatter: float | None) -> Reason:
    """Return what speaks most against a candidate."""
    if sight is None:
        return Reason.WEAK
    if abs(sight.reference - best) > SAME_TRACK:
        return Reason.INCONSISTENT
    if not sight.enough_rivals:
        return Reason.TOO_FEW_RIVALS
    return Reason.AMBIGUOUS if sight.margin < (scatter or 0.0) else Reason.WEAK


def decide(candidates: Sequence[Candidate], config: AcceptanceConfig) -> Reason:
    """
    Decide by the margin between the best candidate and its best rival.

    Parameters
    ----------
    candidates : sequence of Candidate
        At least one, best first, neighbours left out.
    config : AcceptanceConfig
        The least margin.

    Notes
    -----
    The paper always answers with the best candidate. Scores of unrelated places lie too near those
    of true ones for an absolute threshold, so the margin decides.

    """
    if len(candidates) < 2:
        return Reason.TOO_FEW_RIVALS
    margin = candidates[0].score - candidates[1].score
    return Reason.ACCEPTED if margin >= config.min_margin else Reason.AMBIGUOUS


def confidence(evidence: float) -> float:
    """
    Return the probability that a candidate is right, in [0, 1], given its track evidence.

    A logistic function of the logarithm, between those that fit drawn streets some of whose
    buildings repeat (scripts/fit_acceptance.py), which is lower, and real images made dark, which
    is higher.
    """
    offset, slope = _CONFIDENCE
    log_odds = offset + slope * math.log(max(evidence, 0.0) + _LEAST_EVIDENCE)
    return 1.0 / (1.0 + math.exp(-log_odds))
