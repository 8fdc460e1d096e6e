# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The best few places among all scores."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import islice

from convseq_ros.config import AcceptanceConfig
from convseq_ros.core.decision.acceptance import Acceptance
from convseq_ros.core.decision.track_evidence import TRACK
from convseq_ros.core.map.place import Place
from convseq_ros.core.sequence.diagonals import diagonal, Values
from convseq_ros.core.types import Candidate, Candidates, Indices, Reason
import numpy as np


def best_candidates(
    ends: Indices, scores: Values, places: Sequence[Place], config: AcceptanceConfig
) -> Candidates:
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


def ranked(
    acceptance: Acceptance,
    ends: Indices,
    scores: Values,
    places: Sequence[Place],
    config: AcceptanceConfig,
) -> Candidates:
    """Return the best places, and what is verified of them; first what speaks most for itself."""
    found = best_candidates(ends, scores, places, config)
    surest = acceptance.surest() if acceptance.verifies else None
    if surest and surest[1] >= config.min_evidence:
        reference = surest[0]
        (score,) = scores[ends == reference]
        score = score if np.isfinite(score) else acceptance.newest_score(reference)
        first = Candidate(reference, places[reference].stamp_ns, float(score))
        found = with_first(first, found, config)
    return tuple(replace(one, inliers=acceptance.inliers(one.reference_index)) for one in found)


def with_first(first: Candidate, candidates: Candidates, config: AcceptanceConfig) -> Candidates:
    """Return candidates with another as the first, unless they have that place there already."""

    def apart(one: Candidate, distance: int) -> bool:
        return abs(one.reference_index - first.reference_index) > distance

    if candidates and not apart(candidates[0], TRACK.same_track):
        return candidates
    others = (one for one in candidates if apart(one, config.rival_distance))
    return first, *islice(others, config.num_candidates - 1)
