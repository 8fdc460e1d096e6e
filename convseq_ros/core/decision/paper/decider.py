# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's decision: the best diagonal is a match if it leads its rivals by a margin."""

from convseq_ros.config import AcceptanceConfig, Config
from convseq_ros.core.decision.decider import Answer, candidate, Decider, distinct_peaks, Query
from convseq_ros.core.decision.paper.length import choose_length
from convseq_ros.core.decision.paper.pair_score import PaperSimilarity
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.retrieval.coarse_scores import AllPlaces
from convseq_ros.core.types import Candidates, Doubles, Flags, Indices, Reason
import numpy as np


class PaperDecider(Decider):
    """
    Scores k frames against k places in a row, at the map's velocity, without odometry (III-D, G).

    Notes
    -----
    The paper always answers, as `acceptance_rule: always` does. With `margin` the best must lead
    its best rival, more than `rival_distance` away, by `min_margin`, because scores of unrelated
    places are nearly as high.

    """

    def __init__(self, reference_map: ReferenceMap, coarse: AllPlaces, config: Config) -> None:
        self._map, self._coarse, self._similarity = reference_map, coarse, PaperSimilarity()
        self._listed = config.matching.shortlist_length
        self._shares_regions = config.sequence.sequence_regions == 'newest'

    def reset(self) -> None:
        self._coarse.reset()

    def decide(self, query: Query) -> Answer:
        """Return the best places by their sequence scores."""
        buffer, newest = query.buffer, query.buffer.newest
        # III-E, III-F: information gain and entropy choose k, the number of frames to match.
        length = choose_length(buffer.descriptors, self._similarity, query.config.sequence)
        self._coarse.update(newest.descriptor, query.usable)
        ends = self._coarse.best(self._listed, self._listed // 4, query.barred)
        if length is None:
            pairs = buffer.score(1, ends)  # these scores are cached for the next frames
            return Answer(Reason.WARMING_UP, pairs_scored=pairs)
        # III-D: pair scores; III-G: sums along diagonals; the best sequences are the candidates.
        if self._shares_regions:
            buffer = buffer.with_regions_of_newest(length)
        pairs = buffer.score(length, ends)
        candidates = self._best(ends, buffer.best_scores(length, ends), query.config.acceptance)
        return Answer(
            self._reason(candidates, length, query), candidates, length, pairs_scored=pairs
        )

    def _reason(self, candidates: Candidates, length: int, query: Query) -> Reason:
        config = query.config.acceptance
        if not candidates:
            starts = self._map.bounds.starts
            spans = np.diff(starts[starts < query.usable], append=query.usable)
            is_short = spans.max(initial=0) < length
            return Reason.MAP_TOO_SHORT if is_short else Reason.WARMING_UP
        return (
            Reason.ACCEPTED
            if config.acceptance_rule == 'always'
            else decide_by_margin(candidates, config)
        )

    def _best(self, ends: Indices, scores: Doubles, config: AcceptanceConfig) -> Candidates:
        def near(peak: int) -> Flags:
            return self._map.bounds.near(ends, int(ends[peak]), config.rival_distance)

        places, count = self._map.places, max(2, config.num_candidates)
        return tuple(
            candidate(places, int(ends[peak]), float(scores[peak]))
            for peak in distinct_peaks(scores, count, near)
        )


def decide_by_margin(candidates: Candidates, config: AcceptanceConfig) -> Reason:
    """Return ACCEPTED if the first candidate leads the second by `min_margin`."""
    if len(candidates) < 2:
        return Reason.TOO_FEW_RIVALS
    lead = candidates[0].score - candidates[1].score
    return Reason.ACCEPTED if lead >= config.min_margin else Reason.AMBIGUOUS
