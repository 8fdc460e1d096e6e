# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The decision by the belief: a place is a match if it holds nearly all of the mass."""

from dataclasses import replace
from functools import lru_cache, partial
import math

from convseq_ros.config import Config
from convseq_ros.core.decision.belief import Belief
from convseq_ros.core.decision.budget import BUDGET
from convseq_ros.core.decision.comparison import Comparer
from convseq_ros.core.decision.covisibility import Covisibility, KeypointWitness
from convseq_ros.core.decision.decider import Answer, candidate, Decider, distinct_peaks, Query
from convseq_ros.core.decision.expected_lead import ExpectedLead, Light
from convseq_ros.core.decision.likelihood import strength_of, unverified
from convseq_ros.core.decision.motion import MotionModel
from convseq_ros.core.decision.observation import Observation, Observer
from convseq_ros.core.decision.odometry import OdometryJumps, OdometryPrior
from convseq_ros.core.geometry.verification import NOTHING
from convseq_ros.core.graph.links import LINKS
from convseq_ros.core.graph.neighbourhood import Neighbourhood, SAME_PLACE
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.retrieval.coarse_scores import AllPlaces
from convseq_ros.core.sequence.query_buffer import BUFFER, diagonal, evidence_length, novelty
from convseq_ros.core.similarity.scorer import Scorer
from convseq_ros.core.types import (
    Candidate,
    Candidates,
    Doubles,
    Flags,
    Frame,
    Indices,
    Pose,
    Reason,
)
import numpy as np

_KEPT_ENDS = 64  # ends of drives of which is cached where their scene is seen again


class BeliefDecider(Decider):
    """
    One step of a Bayes filter per keyframe: predict, observe, update, decide.

    A place is a match if it holds at least `min_confidence` of the mass, and the newest frame is
    not denied by both witnesses.
    """

    def __init__(
        self, reference_map: ReferenceMap, matcher: Scorer, coarse: AllPlaces, config: Config
    ) -> None:
        matching, robot = config.matching, config.robot
        both, error = matching.both_directions, robot.odometry_way_error
        self._map, self._near = reference_map, Neighbourhood(reference_map)
        keypoints = config.keyframes.keypoints
        self._light = Light(reference_map, bool(keypoints))
        self._lead = ExpectedLead(self._light.differences)
        self._jumps = OdometryJumps()
        self._prior = OdometryPrior(reference_map, robot, config.online.grows)
        witness = KeypointWitness(reference_map, keypoints)
        self._comparer = Comparer(coarse, matcher, self._near, matching.shortlist_length)
        self._matcher, self._witness = matcher, witness
        self._covisibility = Covisibility(reference_map, matcher, witness)
        # Not a method: without a reference cycle, an unused map is freed at once.
        known = partial(_onward, reference_map, coarse, self._covisibility)
        onward = lru_cache(_KEPT_ENDS)(known)
        way = MotionModel(reference_map, both, error)
        self._belief = Belief(reference_map, way, self._lead, onward)
        self._observer = Observer(self._near, witness, self._covisibility)

    @property
    def odometry_jumps(self) -> int:
        """How many steps of odometry were left out, since no robot can have made them."""
        return self._jumps.count

    def reset(self) -> None:
        self._belief.reset()
        self._lead.reset()
        self._comparer.reset()
        self._observer.reset()
        self._light.reset()
        self._prior.reset()
        self._jumps.reset()

    def expect(self, places: Indices, weights: Doubles, earlier: int) -> None:
        self._belief.expect(places, weights, earlier)

    def use_matches_of(self, other: object) -> None:
        """Use the matches and the odometry of the decider of another camera of the robot."""
        if isinstance(other, BeliefDecider):
            self._prior.use_matches_of(other._prior)

    def follow(self, frame: Frame, config: Config) -> None:
        """Take in the odometry of a frame; after a jump, the step to the next one is unknown."""
        if self._jumps.observe(frame.stamp_ns, _used(frame.pose, config)):
            self._belief.motion.forget_pose()
            self._prior.forget_poses()

    def decide(self, query: Query) -> Answer:
        """Return the likeliest places; the confidence is the mass of the first."""
        frame, belief, newest = query.frame, self._belief, query.buffer.newest.descriptor
        self._light.observe(frame, newest)
        if query.missing > BUFFER.longest_gap:
            belief.reset()
        pose = _used(frame.pose, query.config)
        new = novelty(query.buffer.frames)
        belief.motion.move(pose, query.missing, new)
        self._prior.move(frame.stamp_ns, pose)
        belief.predict(query.usable, query.drive_start)
        likely = [place for place in belief.likeliest(BUDGET.peaks) if query.may_match(place)]
        compared = self._comparer.compare(query, likely)
        observed = self._observer.observe(query, compared, belief, new)
        entry = self._prior.entry_prior(observed.places, query.session_start)
        belief.update(
            observed.places,
            observed.log_ratios,
            entry,
            query.usable,
            query.drive_start,
            observed.keypoints,
        )
        query.buffer.note(compared.row, self._evidence(observed))
        answer = self._answer(query, observed)
        return replace(answer, pairs_scored=compared.pairs_scored)

    def _evidence(self, observed: Observation) -> float:
        """Return the log ratio by which a frame speaks for the likeliest place, at least 0."""
        if not len(self._belief.places):
            return 0.0
        best = self._belief.places[self._belief.mass.argmax()]
        return max(0.0, float(observed.log_ratios[np.searchsorted(observed.places, best)]))

    def _answer(self, query: Query, observed: Observation) -> Answer:
        belief, config = self._belief, query.config.acceptance
        length = evidence_length(query.buffer.frames)
        if not len(belief.places):
            return Answer(Reason.WEAK, (), length, 0.0)
        best = int(belief.places[belief.mass.argmax()])
        is_same = self._near.mask(belief.places, best, SAME_PLACE)
        confidence, implausible_m = min(1.0, self._shown(best, is_same)), None
        is_sure = confidence >= config.min_confidence
        if is_sure and self._both_deny(is_same, observed):
            reason = Reason.WEAK
        elif is_sure and best >= query.drive_start and self._is_in_view(best, query):
            reason = Reason.RECENT
        elif is_sure and not self._prior.is_denied(best, query.session_start):
            if observed.asked:
                self._lead.learn(belief.expected_leads(is_same), best, query.drive_start)
            reason, best = Reason.ACCEPTED, self._best_look(best, observed)
            implausible_m = self._prior.implausible_m(best, query.session_start)
            self._prior.fix(best)
            self._comparer.end_search()
        elif (implausible_m := self._prior.implausible_m(best, query.session_start)) is not None:
            reason = Reason.IMPLAUSIBLE
        elif not observed.has_rivals:
            reason = Reason.TOO_FEW_RIVALS
        else:
            others = 1 - belief.elsewhere - confidence
            reason = Reason.AMBIGUOUS if others > belief.elsewhere else Reason.WEAK
        candidates = self._candidates(best, observed, query)
        return Answer(reason, candidates, length, confidence, implausible_m)

    def _both_deny(self, is_same: Flags, observed: Observation) -> bool:
        """
        Return whether cells and keypoints of a frame both deny the likeliest place.

        `is_same` (n,) says which places of the belief show it. Cells alone leave a mean ratio of
        at least 1 - r. Keypoints deny if they leave at most half of that.
        """
        belief = self._belief
        log_ratios = observed.log_ratios[np.searchsorted(observed.places, belief.places[is_same])]
        held = belief.mass[is_same]
        predicted = held * np.exp(-log_ratios)  # up to a factor
        return bool(held.sum() < math.exp(unverified()) / 2 * predicted.sum())

    def _is_in_view(self, place: int, query: Query) -> bool:
        """
        Return whether a place of the drive has been in view ever since.

        A map whose newest place may be matched grows no more, and cannot tell. Without keypoints,
        the robot leaves the place if the oldest frame of the buffer shows it more than the newest.
        """
        if self._witness.knows(place):
            return query.usable < len(self._map) and self._covisibility.is_in_view(place)
        known = [one.features for one in query.buffer.frames if one.features is not None]
        newest, oldest = (
            self._matcher.verified(features, [place]).get(place, NOTHING)
            for features in (known[0], known[-1])
        )
        return strength_of(newest) < strength_of(oldest)

    def _shown(self, best: int, is_same: Flags) -> float:
        """
        Return the probability that the newest frame shows the scene of the likeliest place.

        Places of the belief that show the place, `is_same` (n,), count whole, and the likeliest
        of the others by the share of its scene that they show.
        """
        belief = self._belief
        others = np.flatnonzero(~is_same & (belief.mass >= BUDGET.shares_from))
        others = others[np.argsort(-belief.mass[others], kind='stable')][: BUDGET.scored]
        shares = self._covisibility.shares(best, belief.places[others])
        return float(belief.mass[is_same].sum() + belief.mass[others] @ shares)

    def _best_look(self, best: int, observed: Observation) -> int:
        """Return the strongest look of a place for the newest frame, or the place beside it."""
        strengths = self._strengths(best, observed)
        strongest = max(strengths, key=lambda look: strengths[look], default=best)
        if strongest not in self._map.bounds.around(best, SAME_PLACE):
            return strongest
        beside = [look for look in strengths if look in self._map.bounds.around(best, 1)]
        return max(beside, key=lambda look: strengths[look], default=best)

    def _strengths(self, best: int, observed: Observation) -> dict[int, float]:
        """Return the verification scores of a place and of its looks that were verified."""
        verified = np.array([*observed.verified], np.int64)
        looks = verified[self._near.mask(verified, best, SAME_PLACE)].tolist()
        return {look: strength_of(observed.verified[look]) for look in looks}

    def _candidates(self, best: int, observed: Observation, query: Query) -> Candidates:
        """Return the modes of the belief, best first, no two of them near each other."""
        config, places = query.config.acceptance, self._belief.places

        def near(place: int) -> Flags:
            return self._map.bounds.near(places, place, config.rival_distance)

        left = np.where(near(best), -np.inf, self._belief.mass)
        others = distinct_peaks(left, config.num_candidates - 1, lambda at: near(int(places[at])))
        modes = best, *places[others].tolist()
        return tuple(self._candidate(mode, observed, query) for mode in modes)

    def _candidate(self, index: int, observed: Observation, query: Query) -> Candidate:
        near = self._map.bounds.around(index, 1)
        inliers = [
            observed.verified[at].inliers for at in (index, *near) if at in observed.verified
        ]
        score = self._score(index, query)
        return candidate(self._map.places, index, score, inliers[0] if inliers else None)

    def _score(self, index: int, query: Query) -> float:
        """Return the mean of the pair scores along the diagonal that ends at a place."""
        rows = query.buffer.rows[: evidence_length(query.buffer.frames)]
        velocity = self._belief.velocity(index)
        first, end = self._map.bounds.span(index)
        met = zip(rows, diagonal(len(rows), velocity or 1e-9), strict=True)
        pairs = [
            float(row[index - step])
            for row, step in met
            if row is not None and first <= index - step < min(end, len(row))
        ]
        scores = [score for score in pairs if score >= 0]  # not NaN
        return sum(scores) / len(scores) if scores else 0.0


def _onward(
    reference_map: ReferenceMap,
    coarse: AllPlaces,
    covisibility: Covisibility,
    last: int,
    earlier: int,
) -> tuple[Indices, Doubles]:
    """
    Return which of the first `earlier` places show the scene of the last one of a drive.

    They are among those that are most like it, beyond those beside it.
    """
    beside = [reference_map.bounds.around(last, LINKS.neighbour_radius)]
    return covisibility.shown(last, coarse.like(last, earlier, BUDGET.scored, beside))


def _used(pose: Pose | None, config: Config) -> Pose | None:
    """Return a pose of odometry, if odometry is used."""
    return pose if config.robot.odometry_way_error else None
