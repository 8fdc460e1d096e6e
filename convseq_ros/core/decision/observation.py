# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The observation: how many times likelier a frame is at each place than elsewhere."""

from collections.abc import Mapping
from dataclasses import dataclass, field
import math

from convseq_ros.core.decision.belief import Belief
from convseq_ros.core.decision.budget import BUDGET
from convseq_ros.core.decision.comparison import COMPARED, Comparison, has_controls
from convseq_ros.core.decision.covisibility import Covisibility, KeypointWitness
from convseq_ros.core.decision.decider import Query
from convseq_ros.core.decision.expected_lead import (
    keypoint_ratios,
    KeypointRatio,
    KEYPOINTS,
    ratios_of,
    STATES,
)
from convseq_ros.core.decision.likelihood import (
    COPIES,
    Evidence,
    gain_of,
    Likelihood,
    strength_of,
    unverified,
)
from convseq_ros.core.geometry.verification import Verification
from convseq_ros.core.graph.neighbourhood import Neighbourhood, SAME_PLACE
from convseq_ros.core.types import Doubles, Indices
import numpy as np


@dataclass(frozen=True, eq=False, slots=True)
class Observation:
    """The likelihood ratios of a frame."""

    places: Indices  # (n,), ascending
    log_ratios: Doubles  # (n,)
    verified: Mapping[int, Verification]  # by place
    has_rivals: bool  # whether there are enough controls to accept a match
    asked: Mapping[int, KeypointRatio] = field(default_factory=dict)  # by place
    keypoints: Doubles | None = None  # (6, n), their ratios by state; None if they are not asked


class Observer:
    """Turns what the frames of one camera's drive show into likelihood ratios of places."""

    def __init__(
        self, near: Neighbourhood, witness: KeypointWitness, covisibility: Covisibility
    ) -> None:
        self._near, self._covisibility = near, covisibility
        self._witness, self._likelihood = witness, Likelihood()

    def reset(self) -> None:
        self._likelihood.reset()

    def observe(
        self, query: Query, compared: Comparison, belief: Belief, novelty: float = 1.0
    ) -> Observation:
        """
        Return the likelihood ratios of a query, by its comparison and by how new its image is.

        They are given for all scored places and for all that hold mass in the predicted belief.
        """
        places, verified = np.union1d(compared.places, belief.places), compared.verified
        if not verified:
            ratio = unverified() if len(compared.places) else 0.0
            return Observation(places, np.full(len(places), ratio), {}, False)
        examined = np.array(sorted(verified))
        strengths = np.array([strength_of(verified[place]) for place in examined.tolist()])
        strongest = examined[np.argsort(-strengths, kind='stable')]
        best = int(strongest[0])
        is_rival = np.isin(examined, compared.peaks) & ~self._near.mask(examined, best)
        has_rivals = has_controls(self._near, compared.places, best) and bool(is_rival.any())
        scores = compared.scores[np.searchsorted(compared.places, examined)]
        observed = strengths, scores, is_rival
        leads = self._likelihood.leads(*observed)
        follows, chance = self._expected(query, belief, best)
        asked = dict[int, KeypointRatio]()
        by_cells = float(leads.cells[examined == best][0]) + gain_of(follows, chance)
        if by_cells < KEYPOINTS.surprising or not self._is_sure(query, belief, best):
            share = self._covisibility.share
            leads = self._likelihood.leads(*observed, lambda at: share(best, int(examined[at])))
            asked = self._asked(query, belief, strongest, verified)
        self._likelihood.learn(*observed)
        keypoints = self._by_keypoints(places, asked)
        at = np.searchsorted(places, examined)
        states = belief.states_at(examined, query.drive_start)
        evidence = Evidence(
            leads.cells,
            np.log((states * keypoints[:, at]).sum(axis=0)),
            self._near.distances(examined, examined, COMPARED.verify_radius),
            self._near.within(examined, best, COMPARED.verify_radius) & has_rivals,
            follows,
            chance,
            math.exp(asked[best].ratio) if best in asked else 1.0,
            _weight(query, novelty) if has_rivals else 0.0,
        )
        log_ratios = np.full(len(places), unverified())
        log_ratios[at] = self._likelihood.log_ratios(evidence)
        by_state = keypoints if asked else None
        return Observation(places, log_ratios, verified, has_rivals, asked, by_state)

    def _expected(self, query: Query, belief: Belief, best: int) -> tuple[float, float]:
        """Return how far the belief, and how far chance expects the strongest place there."""
        chance = min(1.0, COPIES.by_chance / query.usable)
        if belief.elsewhere >= 1:
            return 0.0, chance
        is_beside = self._near.within(belief.places, best, COMPARED.verify_radius)
        return float(belief.mass[is_beside].sum()) / (1 - belief.elsewhere), chance

    def _is_sure(self, query: Query, belief: Belief, best: int) -> bool:
        """Return whether the belief expects the strongest place, with hardly any doubt."""
        doubted = BUDGET.doubt * (1 - query.config.acceptance.min_confidence)
        is_same = self._near.mask(belief.places, best, SAME_PLACE)
        return 1 - float(belief.mass[is_same].sum()) <= doubted

    def _asked(
        self,
        query: Query,
        belief: Belief,
        strongest: Indices,
        verified: Mapping[int, Verification],
    ) -> dict[int, KeypointRatio]:
        """
        Return what keypoints say of the strongest places that are apart and of the likeliest one.

        `strongest` are the verified places (n,), best first. The likeliest place is not asked if
        one beside it is. Empty without keypoints.
        """
        features, chosen = query.features, list[int]()
        for place in strongest.tolist():
            is_apart = not any(self._near.is_near(place, other) for other in chosen)
            if is_apart and len(chosen) < BUDGET.asked:
                chosen.append(place)
        for place in belief.likeliest(1):
            is_beside = self._near.within(np.array(chosen), place, COMPARED.verify_radius)
            if place in strongest and not is_beside.any():
                chosen.append(place)
        # Nothing is detected in a frame that cannot be compared.
        chosen = [place for place in chosen if self._witness.knows(place)]
        if not chosen or features.packed is None:
            return {}
        keypoints = self._witness.keypoints(query.frame, query.buffer.newest.descriptor)
        if keypoints is None:
            return {}
        side = features.packed.side
        blocks = {
            place: self._witness.blocks(keypoints, place, verified[place].moved, side)
            for place in chosen
        }
        states = belief.states_at(np.array([*blocks], np.int64), query.drive_start)
        shares = dict(zip(blocks, states.T, strict=True))
        return keypoint_ratios(blocks, shares, self._near.is_near)

    def _by_keypoints(self, places: Indices, asked: Mapping[int, KeypointRatio]) -> Doubles:
        """
        Return the likelihood ratios (6, n) of places (n,) by keypoints and state.

        They are 1 where keypoints say nothing. Those that deny a place deny the places beside it.
        """
        by_state, is_asked = np.ones((STATES, len(places))), np.isin(places, [*asked])
        for place, answer in asked.items():
            ratios = ratios_of(answer.lead)[:, None]
            beside = self._near.within(places, place, SAME_PLACE) & ~is_asked
            by_state[:, beside] = np.minimum(by_state[:, beside], ratios)
            by_state[:, places == place] = ratios
        return by_state


def _weight(query: Query, novelty: float) -> float:
    """
    Return how much a frame counts as evidence for a place, in [0, 1].

    As in the paper, by information gain (III-E) and entropy (III-F): an image that shows nothing
    new says nothing new, and one below the threshold of entropy says less.
    """
    entropy = query.buffer.newest.descriptor.entropy
    enough = query.config.sequence.entropy_threshold
    return novelty * (min(1.0, entropy / enough) if enough else 1.0)
