# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The comparison: which places a frame is compared with, and what it has in common with them.

The likeliest places get rough scores. The best of these, and the best elsewhere (controls), get
pair scores. The best of these are verified.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from convseq_ros.core.decision.budget import BUDGET
from convseq_ros.core.decision.decider import distinct_peaks, Query
from convseq_ros.core.decision.likelihood import strength_of
from convseq_ros.core.geometry.verification import Verification
from convseq_ros.core.graph.neighbourhood import Neighbourhood
from convseq_ros.core.retrieval.coarse_scores import AllPlaces
from convseq_ros.core.similarity.scorer import Features, Scorer
from convseq_ros.core.types import constants, Doubles, Indices, Row
import numpy as np


@constants
class COMPARED:
    """What decides besides the work: how near is beside, and how many controls are enough."""

    verify_radius: int = 2  # places to either side of the best that are verified, too
    fewest: int = 8  # controls that must be scored; with fewer, no place has a positive ratio


@dataclass(frozen=True, eq=False, slots=True)
class Comparison:
    """Places that a frame was compared with."""

    row: Row  # pair scores (usable,), NaN where not scored
    pairs_scored: int
    places: Indices  # (n,), those with a pair score, ascending
    scores: Doubles  # (n,), their pair scores
    verified: Mapping[int, Verification]  # of some of them, by place
    peaks: Sequence[int]  # places with the best pair scores, apart from each other


class Comparer:
    """Compares the frames of one camera's drive with the map."""

    def __init__(
        self, coarse: AllPlaces, matcher: Scorer, near: Neighbourhood, listed: int
    ) -> None:
        self._coarse, self._matcher, self._near = coarse, matcher, near
        self._listed = listed
        self.reset()

    def reset(self) -> None:
        self._coarse.reset()
        self._frames = 0  # of the drive

    def end_search(self) -> None:
        """Compare frames with fewer places from now on: the drive has its first match."""
        self._frames = BUDGET.first_frames

    def compare(self, query: Query, predicted: Sequence[int]) -> Comparison:
        """Compare a query with places, among them the likeliest as `predicted`, best first."""
        self._coarse.update(query.buffer.newest.descriptor, query.usable)
        features, before = query.features, np.array(predicted, np.int64)
        row = np.full(query.usable, np.nan, np.float32)
        self._frames += 1
        is_first = self._frames <= BUDGET.first_frames
        newest = BUDGET.first_listed if is_first else self._listed // 4
        likely = np.union1d(self._coarse.best(self._listed, newest, query.barred), before)
        most = BUDGET.first_scored if is_first else BUDGET.scored
        likely = self._promising(features, likely, most)
        pairs = self._score(features, np.union1d(likely, before), row)
        places, scores = _scored(row)
        if not len(places):
            return Comparison(row, pairs, places, scores, {}, ())
        peaks = self._peaks(places, scores, BUDGET.peaks)
        checked = [place for place in before[: BUDGET.checked].tolist() if place in places]
        verified = self._verified(features, {}, [*peaks, *checked])
        best = _strongest(verified, peaks[0])
        beside = places[self._near.within(places, best, COMPARED.verify_radius)]
        verified = self._verified(features, verified, beside.tolist())
        best = _strongest(verified, peaks[0])
        if not has_controls(self._near, places, best):
            excluded = [*self._near.ranges(best), *query.barred]
            others = self._coarse.best(COMPARED.fewest, 0, excluded)
            pairs += self._score(features, others, row)
            places, scores = _scored(row)
            is_away = ~self._near.mask(places, best)
            more = self._peaks(places[is_away], scores[is_away], BUDGET.peaks - 1)
            verified = self._verified(features, verified, more)
            peaks += more
        return Comparison(row, pairs, places, scores, verified, peaks)

    def _score(self, features: Features, places: Indices, row: Row) -> int:
        """Score a query against places, each once; return how many pairs were scored."""
        missing = places[np.isnan(row[places])]
        row[missing] = self._matcher.scores_of([(features, missing)])[0]
        return len(missing)

    def _promising(self, features: Features, places: Indices, most: int) -> Indices:
        """Return the `most` best places by rough scores, with at least 8 controls among them."""
        rough = self._matcher.rough_scores(features, places) if len(places) > most else None
        if rough is None:
            return places
        order = np.argsort(-np.nan_to_num(rough, nan=-1.0), kind='stable')
        is_near = self._near.mask(places, int(places[order[0]]))[order]
        near_by, away = places[order[is_near]], places[order[~is_near]]
        controls = min(len(away), max(COMPARED.fewest, most - len(near_by)))
        return np.r_[near_by[: most - controls], away[:controls]]

    def _peaks(self, places: Indices, scores: Doubles, count: int) -> list[int]:
        """Return the best places by pair score that are not near each other, best first."""
        peaks = distinct_peaks(scores, count, lambda at: self._near.mask(places, int(places[at])))
        return places[peaks].tolist()

    def _verified(
        self, features: Features, known: Mapping[int, Verification], places: Sequence[int]
    ) -> dict[int, Verification]:
        """Return the known verifications, and those of more places."""
        missing = [place for place in dict.fromkeys(places) if place not in known]
        return {**known, **self._matcher.verified(features, missing)}


def has_controls(near: Neighbourhood, places: Indices, best: int) -> bool:
    """Return whether enough places (n,) show neither the best one nor one near it."""
    return int((~near.mask(places, best)).sum()) >= COMPARED.fewest


def _strongest(verified: Mapping[int, Verification], otherwise: int) -> int:
    """Return the place with the highest strength, the first of equals."""
    return max(verified, key=lambda place: strength_of(verified[place]), default=otherwise)


def _scored(row: Row) -> tuple[Indices, Doubles]:
    """Return the places that have pair scores, ascending, and these scores."""
    places = np.flatnonzero(np.isfinite(row))
    return places, row[places].astype(np.float64)
