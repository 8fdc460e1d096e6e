# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The best few places among all scores."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import islice

from convseq_ros.config import AcceptanceConfig
from convseq_ros.core.constants import constants
from convseq_ros.core.decision.acceptance import Acceptance
from convseq_ros.core.decision.confidence import Judgement
from convseq_ros.core.decision.neighbourhood import Neighbourhood
from convseq_ros.core.decision.track_evidence import TRACK
from convseq_ros.core.map.place import Place
from convseq_ros.core.map.sessions import SessionBounds
from convseq_ros.core.sequence.diagonals import diagonal, ONE_SESSION, Values
from convseq_ros.core.sequence.shortlist import SHORTLIST
from convseq_ros.core.types import Candidate, Candidates, Indices, Reason
import numpy as np


@constants
class PEAK:
    """Of single frames; by Gardens Point and corridor, where 2 to 4 and .6 to .8 are alike."""

    reach: int = SHORTLIST.reach  # places on either side of the best score that may belong to it
    share: float = 0.7  # of the best score, above which they do


def best_candidates(
    ends: Indices,
    scores: Values,
    places: Sequence[Place],
    config: AcceptanceConfig,
    bounds: SessionBounds = ONE_SESSION,
    of_single: bool = False,
) -> Candidates:
    """
    Return the best places, best first, no neighbours; of scores (n,) at `ends`, or -inf.

    Scores `of_single` frames have wide peaks, of which the middle is told.
    """
    remaining = scores.copy()
    found: list[Candidate] = []
    while len(found) < config.num_candidates and np.isfinite(remaining).any():
        top = int(remaining.argmax())
        index = int(ends[top])
        told = _middle(ends, remaining, top, bounds) if of_single else top
        found.append(_candidate(int(ends[told]), float(scores[told]), places))
        remaining[bounds.near(ends, index, config.rival_distance)] = -np.inf
    return tuple(found)


def _middle(ends: Indices, scores: Values, top: int, bounds: SessionBounds) -> int:
    """Return where the middle of a peak is, given where its top is."""
    above = scores - PEAK.share * scores[top]
    peak = np.flatnonzero(bounds.near(ends, int(ends[top]), PEAK.reach) & (above > 0))
    if not len(peak):
        return top
    middle = above[peak] @ ends[peak] / above[peak].sum()
    return int(peak[abs(ends[peak] - middle).argmin()])


def _candidate(index: int, score: float, places: Sequence[Place]) -> Candidate:
    return Candidate(index, places[index].stamp_ns, score, session=places[index].session)


def why_none(usable: int, length: int, velocity: float, bounds: SessionBounds) -> Reason:
    """Return why no sequence of so many frames has a score, with so many usable references."""
    longest = np.diff(bounds.starts[bounds.starts < usable], append=usable).max(initial=0)
    short = longest <= abs(diagonal(length, velocity)[-1])
    return Reason.MAP_TOO_SHORT if short else Reason.WARMING_UP


def decided(
    acceptance: Acceptance,
    ends: Indices,
    scores: Values,
    places: Sequence[Place],
    config: AcceptanceConfig,
    length: int,
) -> tuple[Candidates, Judgement | None]:
    """
    Return the best places, and what is said of the best; of none, None.

    First is what speaks most for itself; a match is where the newest frame shows it to be.
    """

    def candidate(index: int) -> Candidate:
        own = scores[(ends == index) & np.isfinite(scores)]
        return _candidate(
            index, float(own[0]) if len(own) else acceptance.newest_score(index), places
        )

    of_single = length == 1 and acceptance.by_track
    found = best_candidates(ends, scores, places, config, acceptance.places.bounds, of_single)
    surest = acceptance.surest() if acceptance.verifies else None
    if surest and surest[1] >= config.min_evidence:
        found = with_first(candidate(surest[0]), found, config, acceptance.places)
    if not found:
        return found, None
    said = acceptance.judge(found, config)
    if said.reason is Reason.ACCEPTED:
        best = acceptance.placed(found[0].reference_index, config.min_evidence)
        found = candidate(best), *found[1:]
    known = (replace(one, inliers=acceptance.inliers(one.reference_index)) for one in found)
    return tuple(known), said


def with_first(
    first: Candidate,
    candidates: Candidates,
    config: AcceptanceConfig,
    neighbourhood: Neighbourhood | None = None,
) -> Candidates:
    """Return candidates with another as the first, unless they have that place there already."""
    known, own = neighbourhood or Neighbourhood(), first.reference_index
    if candidates and known.is_near(own, candidates[0].reference_index, TRACK.same_track):
        return candidates
    near = known.bounds.around(own, config.rival_distance)
    others = (one for one in candidates if one.reference_index not in near)
    return first, *islice(others, config.num_candidates - 1)
