# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The observation: which places a frame is compared with, and the likelihood ratio of each.

The likeliest places get rough scores. The best of these, and the best elsewhere (controls), get
pair scores. The best of these are verified. The likelihood turns the results into ratios.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
import math

from convseq_ros.core.decision.belief import Belief
from convseq_ros.core.decision.decider import distinct_peaks, Query
from convseq_ros.core.decision.keypoint_witness import KeypointWitness
from convseq_ros.core.decision.likelihood import (
    Evidence,
    gain_of,
    Leads,
    Likelihood,
    strength_of,
    UNVERIFIED,
)
from convseq_ros.core.decision.neighbourhood import Neighbourhood
from convseq_ros.core.decision.paper.query_buffer import QueryBuffer
from convseq_ros.core.decision.usual_lead import answers, Asked, KEYPOINTS, ratios_of, STATES
from convseq_ros.core.geometry.verification import Verification
from convseq_ros.core.graph.links import LINKS
from convseq_ros.core.retrieval.coarse_scores import AllPlaces
from convseq_ros.core.types import constants, Doubles, Indices, Row
import numpy as np


@constants
class OBSERVED:
    """Numbers of places that are scored and verified, beside the shortlist."""

    # The first frames of a drive, up to its first match, search more places, as the mean
    # descriptor of the drive is not known yet: on drawn nights, a median of 130 of 1,083 places
    # have a better coarse score than the right one.
    first_frames: int = 15
    first_listed: int = 400  # in the first frames: listed by the newest frame alone
    # The listed places that get a full pair score, the best by rough scores. On `laps`,
    # 8 lose 2 % of the matches, and 16 gain nothing.
    scored: int = 12
    first_scored: int = 30  # in the first frames
    peaks: int = 6  # best by pair score, apart from each other: they are verified. As many places,
    # the likeliest by the predicted belief, are always scored ...
    checked: int = 2  # ... and this many of them are always verified
    beside: int = 2  # places to either side of the best that are verified, too
    fewest: int = 8  # controls that must be scored; with fewer, no place has a positive ratio
    loss: float = 0.25  # log ratio per place of distance from a place that leads, for those beside
    # Keypoints are asked about the strongest places, apart, and the likeliest one, unless the
    # frame is expected with this share of the doubt that a match may leave, and cells agree.
    asked: int = 3
    doubt: float = 0.1


@dataclass(frozen=True, eq=False, slots=True)
class Observation:
    """The likelihood ratios of a frame."""

    places: Indices  # (n,), ascending
    log_ratios: Doubles  # (n,)
    verified: Mapping[int, Verification]  # by place
    has_rivals: bool  # whether there are enough controls to accept a match
    leads: Leads | None = None  # of the verified places
    asked: Mapping[int, Asked] = field(default_factory=dict)  # by place, what keypoints say
    keypoints: Doubles | None = None  # (6, n), their ratios by state; None if they are not asked


class Observer:
    """Compares the frames of one camera's drive with the map."""

    def __init__(
        self, coarse: AllPlaces, near: Neighbourhood, witness: KeypointWitness, listed: int
    ) -> None:
        self._coarse, self._near, self._listed = coarse, near, listed
        self._witness = witness
        self.likelihood = Likelihood()
        self.reset()

    def reset(self) -> None:
        self._coarse.reset()
        self._witness.reset()
        self.likelihood.reset()
        self._frames = 0  # of the drive

    def end_search(self) -> None:
        """Compare frames with fewer places from now on: the drive has its first match."""
        self._frames = OBSERVED.first_frames

    def observe(self, query: Query, belief: Belief) -> Observation:
        """
        Return the likelihood ratios of a query, which is informative.

        They are given for all scored places and for all that hold mass in the predicted belief.
        """
        buffer, believed = query.buffer, belief.places
        predicted = belief.likeliest(OBSERVED.peaks)
        self._frames += 1
        is_first = self._frames <= OBSERVED.first_frames
        newest = OBSERVED.first_listed if is_first else self._listed // 4
        likely = self._coarse.best(self._listed, newest)
        before = np.array(predicted, np.int64)
        most = OBSERVED.first_scored if is_first else OBSERVED.scored
        likely = self._promising(buffer, np.union1d(likely, before), most)
        places, scores = _scored(buffer, np.union1d(likely, before))
        if not len(places):
            return Observation(believed, np.zeros(len(believed)), {}, False)
        peaks = self._peaks(places, scores, OBSERVED.peaks)
        checked = [place for place in predicted[: OBSERVED.checked] if place in places]
        verified = buffer.verified([*peaks, *checked])
        best = _strongest(verified, peaks[0])
        beside = places[self._near.beside(places, best, OBSERVED.beside)]
        verified |= buffer.verified(beside.tolist())
        best = _strongest(verified, best)
        if len(self._elsewhere(places, best)) < OBSERVED.fewest:
            others = self._coarse.best(OBSERVED.fewest, 0, self._near.ranges(best))
            places, scores = _scored(buffer, np.union1d(places, others))
            away = self._elsewhere(places, best)
            more = self._peaks(away, scores[np.searchsorted(places, away)], OBSERVED.peaks - 1)
            verified |= buffer.verified(more)
            peaks += more
        observed = self._judged(query, belief, places, scores, verified, peaks)
        log_ratios = np.where(observed.log_ratios > 0, _weight(query), 1.0) * observed.log_ratios
        return self._with(replace(observed, log_ratios=log_ratios), believed)

    def _promising(self, buffer: QueryBuffer, places: Indices, most: int) -> Indices:
        """Return the `most` best places by rough scores, with at least 8 controls among them."""
        rough = buffer.rough_scores(places) if len(places) > most else None
        if rough is None:
            return places
        order = np.argsort(-np.nan_to_num(rough, nan=-1.0), kind='stable')
        is_near = self._near.mask(places, int(places[order[0]]))[order]
        near_by, away = places[order[is_near]], places[order[~is_near]]
        controls = min(len(away), max(OBSERVED.fewest, most - len(near_by)))
        return np.r_[near_by[: most - controls], away[:controls]]

    def _judged(
        self,
        query: Query,
        belief: Belief,
        places: Indices,
        scores: Doubles,
        verified: Mapping[int, Verification],
        peaks: Sequence[int],
    ) -> Observation:
        likelihood = self.likelihood
        log_ratios = np.full(len(places), UNVERIFIED)
        if not verified:
            return Observation(places, log_ratios, verified, False)
        order = sorted(verified)
        examined, is_peak = np.array(order), np.array([place in peaks for place in order])
        at = np.searchsorted(places, examined)
        strengths = np.array([strength_of(verified[place]) for place in order])
        best = int(examined[strengths.argmax()])
        is_rival = is_peak & ~self._near.mask(examined, best)
        has_rivals = len(self._elsewhere(places, best)) >= OBSERVED.fewest and bool(is_rival.any())
        leads = likelihood.leads(strengths, scores[at], is_rival)
        chance = min(1.0, (LINKS.neighbour_radius + 1) / query.usable)
        is_followed, mass = belief.elsewhere < 1, self._mass(belief, best, OBSERVED.beside)
        follows = mass / (1 - belief.elsewhere) if is_followed else 0.0
        held = self._mass(belief, best, LINKS.neighbour_radius // 2)
        doubted = 1 - query.config.acceptance.min_confidence
        is_sure = 1 - held <= OBSERVED.doubt * doubted
        by_cells = leads.cells.max() + gain_of(follows, chance)
        asked = dict[int, Asked]()
        if not is_sure or by_cells < KEYPOINTS.surprising:
            strongest = examined[np.argsort(-strengths, kind='stable')]
            asked = self._asked(query, belief, strongest)
        spoken = {place: answer.ratio for place, answer in asked.items()}
        states = belief.states_at(examined, query.session_start)
        evidence = Evidence(
            leads.cells,
            np.log((states * self._by_keypoints(examined, asked)).sum(axis=0)),
            self._near.beside(examined, best, OBSERVED.beside) & has_rivals,
            follows,
            chance,
            math.exp(spoken.get(best, 0.0)),
        )
        # A single frame hardly distinguishes a place from its neighbours.
        log_ratios[at] = self._near.best_beside(
            examined, examined, likelihood.log_ratios(evidence), OBSERVED.beside, OBSERVED.loss
        )
        if not has_rivals:  # no place is likelier than elsewhere
            log_ratios = np.minimum(log_ratios, 0.0)
        return Observation(places, log_ratios, verified, has_rivals, leads, asked)

    def _mass(self, belief: Belief, place: int, distance: int) -> float:
        """Return the probability of the places within a distance of a place."""
        return float(belief.mass[self._near.beside(belief.places, place, distance)].sum())

    def _by_keypoints(self, places: Indices, asked: Mapping[int, Asked]) -> Doubles:
        """
        Return the likelihood ratios (6, n) of places (n,) by keypoints and state.

        They are 1 where keypoints say nothing. Those that deny a place deny the places beside it.
        """
        by_state, is_asked = np.ones((STATES, len(places))), np.isin(places, [*asked])
        for place, answer in asked.items():
            ratios = ratios_of(answer.lead)[:, None]
            beside = self._near.beside(places, place, LINKS.neighbour_radius // 2) & ~is_asked
            by_state[:, beside] = np.minimum(by_state[:, beside], ratios)
            by_state[:, places == place] = ratios
        return by_state

    def _asked(self, query: Query, belief: Belief, strongest: Indices) -> dict[int, Asked]:
        """
        Return what keypoints say of the strongest places that are apart and of the likeliest one.

        `strongest` are the verified places (n,), best first. The likeliest place is not asked if
        one beside it is. Empty without keypoints.
        """
        newest, chosen = query.buffer.newest, list[int]()
        for place in strongest.tolist():
            is_apart = not any(self._near.is_near(place, other) for other in chosen)
            if is_apart and len(chosen) < OBSERVED.asked:
                chosen.append(place)
        for place in belief.likeliest(1):
            is_beside = self._near.beside(np.array(chosen), place, OBSERVED.beside)
            if place in strongest and not is_beside.any():
                chosen.append(place)
        # Nothing is detected in a frame that cannot be compared.
        chosen = [place for place in chosen if self._witness.knows(place)]
        if not chosen or newest.features is None or newest.features.packed is None:
            return {}
        keypoints = self._witness.keypoints(query.frame, newest.descriptor)
        if keypoints is None:
            return {}
        side, motion = newest.features.packed.side, query.buffer.motion
        blocks = {
            place: self._witness.blocks(keypoints, place, motion(place), side) for place in chosen
        }
        states = belief.states_at(np.array([*blocks], np.int64), query.session_start)
        return answers(blocks, dict(zip(blocks, states.T, strict=True)), self._near.is_near)

    def _with(self, observed: Observation, believed: Indices) -> Observation:
        """Return an observation with more places; low ratios spread to unverified neighbours."""
        places = np.union1d(observed.places, believed)
        examined = np.array(sorted(observed.verified), np.int64)
        log_ratios = np.full(len(places), UNVERIFIED)
        at = np.searchsorted(places, observed.places)
        log_ratios[at] = observed.log_ratios
        if len(examined):
            ratios = observed.log_ratios[np.searchsorted(observed.places, examined)]
            best = self._near.best_beside(places, examined, ratios, LINKS.neighbour_radius // 2)
            is_beside = np.isfinite(best)
            is_beside[np.searchsorted(places, examined)] = False
            log_ratios[is_beside] = np.minimum(log_ratios[is_beside], best[is_beside])
        keypoints = self._by_keypoints(places, observed.asked) if observed.asked else None
        return replace(observed, places=places, log_ratios=log_ratios, keypoints=keypoints)

    def _peaks(self, places: Indices, scores: Doubles, count: int) -> list[int]:
        """Return the best places by pair score that are not near each other, best first."""
        peaks = distinct_peaks(scores, count, lambda at: self._near.mask(places, int(places[at])))
        return places[peaks].tolist()

    def _elsewhere(self, places: Indices, best: int) -> Indices:
        return places[~self._near.mask(places, best)]


def _weight(query: Query) -> float:
    """
    Return how much a frame counts as evidence for a place, in [0, 1].

    As in the paper, by information gain (III-E) and entropy (III-F): an image that shows nothing
    new says nothing new, and one below the threshold of entropy says less.
    """
    entropy = query.buffer.newest.descriptor.entropy
    enough = query.config.sequence.entropy_threshold
    return query.buffer.novelty * (min(1.0, entropy / enough) if enough else 1.0)


def _strongest(verified: Mapping[int, Verification], otherwise: int) -> int:
    """Return the place with the highest strength, the first of equals."""
    return max(verified, key=lambda place: strength_of(verified[place]), default=otherwise)


def _scored(buffer: QueryBuffer, places: Indices) -> tuple[Indices, Doubles]:
    """Return the places that have pair scores, ascending, and these scores."""
    buffer.score(1, places)
    row: Row = buffer.rows[0] if buffer.rows[0] is not None else np.zeros(0, np.float32)
    scores = row[places].astype(np.float64)
    is_scored = np.isfinite(scores)
    return places[is_scored], scores[is_scored]
