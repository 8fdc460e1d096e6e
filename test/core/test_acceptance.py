# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Candidates and the decision between them."""

from convseq_ros.config import AcceptanceConfig
from convseq_ros.core.acceptance import decide
from convseq_ros.core.candidates import best_candidates
from convseq_ros.core.reference_map import Place
from convseq_ros.core.types import Candidate, Reason
import numpy as np
import pytest

RULE = AcceptanceConfig(min_margin=0.01, rival_distance=2, num_candidates=3)


def candidates(scores, config=RULE):
    places = [Place(1000 + index) for index in range(len(scores))]
    return best_candidates(np.array(scores, float), places, config)


def test_candidates_come_best_first_without_neighbours():
    found = candidates([0.1, 0.8, 0.9, 0.85, 0.2, 0.3, 0.7])
    assert [each.reference_index for each in found] == [2, 6]
    assert found[0] == Candidate(2, 1002, 0.9)


def test_no_more_candidates_than_asked_for():
    assert len(candidates(np.linspace(0, 1, 50))) == 3


def test_places_without_score_are_no_candidates():
    assert candidates([-np.inf] * 5) == ()
    assert len(candidates([-np.inf, -np.inf, 0.5])) == 1


@pytest.mark.parametrize(
    ('scores', 'reason'),
    [
        ([0.9, 0, 0, 0.88], Reason.ACCEPTED),
        ([0.9, 0, 0, 0.895], Reason.AMBIGUOUS),
        ([0.9, 0.899, 0.1, 0.2], Reason.ACCEPTED),
        ([0.9, 0.8, 0.1], Reason.TOO_FEW_RIVALS),
    ],
)
def test_the_margin_to_the_best_rival_decides(scores, reason):
    assert decide(candidates(scores), RULE) is reason
