# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The decider that a configuration asks for."""

from convseq_ros.config import Config
from convseq_ros.core.decision.belief import Belief
from convseq_ros.core.decision.belief_decider import BeliefDecider
from convseq_ros.core.decision.decider import Decider
from convseq_ros.core.decision.motion import MotionModel
from convseq_ros.core.decision.odometry_prior import OdometryPrior
from convseq_ros.core.decision.paper_decider import PaperDecider
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.sequence.coarse_scores import Coarse, CoarseScores, EveryPlace


def make_decider(
    reference_map: ReferenceMap, config: Config, coarse: Coarse | None = None
) -> Decider:
    """Return what decides, with what knows coarse scores, if that is told."""
    matching = config.matching
    if matching.search == 'exhaustive':
        coarse = EveryPlace()
    coarse = coarse or CoarseScores(reference_map, matching.both_directions)
    listed = matching.shortlist_length
    if not config.believes:
        return PaperDecider(reference_map, coarse, listed)
    way_error = config.robot.odometry_way_error
    belief = Belief(reference_map, MotionModel(reference_map, matching.both_directions, way_error))
    prior = OdometryPrior(reference_map, config.robot, config.online.grows)
    return BeliefDecider(reference_map, coarse, listed, belief, prior)
