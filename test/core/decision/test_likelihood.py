# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The likelihood ratio, worked by hand."""

import math

from convseq_ros.core.decision.likelihood import (
    Evidence,
    gumbel_scale,
    Leads,
    Likelihood,
    strength_of,
)
from convseq_ros.core.geometry.verification import Verification
import numpy as np
import pytest

ALL = 0.0005  # share of frames elsewhere whose cells look like a place in every respect
SCENES = 1e-4  # ... and whose keypoints agree as a scene
ALONE = np.zeros((1, 1))  # a place is at no distance from itself
FAR = np.where(np.eye(4), 0.0, np.inf)  # of four places, none says anything of another


def ratio(cells=0.0, keypoints=0.0, is_strongest=False, follows=0.0, chance=0.01, affirmed=1.0):
    place = np.array([cells]), np.array([keypoints]), np.array([is_strongest])
    evidence = Evidence(*place[:2], ALONE, place[2], follows, chance, affirmed, 1.0)
    return math.exp(Likelihood().log_ratios(evidence)[0])


@pytest.mark.parametrize(
    ('evidence', 'expected'),
    [
        ({}, 1.0),
        ({'cells': math.log(10)}, 0.9 * 10 + 0.1),
        ({'cells': -40.0}, 0.1),  # cells may fail to show a true place
        # The strongest place of a drive elsewhere lies anywhere: 1 in 100 here.
        ({'is_strongest': True}, 0.9 * 100 + 0.1),
        ({'is_strongest': True, 'chance': 0.5}, 0.9 * 2 + 0.1),
        # If the belief predicted it: as a copy would, in 30 % of drives past copies.
        ({'is_strongest': True, 'follows': 1.0}, 0.9 / 0.31 + 0.1),
        ({'is_strongest': True, 'follows': 0.5}, 0.9 / 0.16 + 0.1),
        ({'is_strongest': True, 'follows': 1.0, 'chance': 1.0}, 1.0),
        # Keypoints that deny make a copy likelier; those that affirm are counted by themselves.
        ({'is_strongest': True, 'follows': 1.0, 'affirmed': 0.1}, 0.9 / (0.3 / 0.37 + 0.01) + 0.1),
        ({'is_strongest': True, 'follows': 1.0, 'affirmed': 50.0}, 0.9 / 0.31 + 0.1),
        ({'follows': 1.0, 'affirmed': 0.1}, 1.0),  # of another place
        ({'cells': 300.0, 'is_strongest': True}, 1e100),
    ],
)
def test_likelihood_ratios_are_those_worked_by_hand(evidence, expected):
    bounded = min(expected, max(1.0, expected / (1 + ALL * expected)))
    assert ratio(**evidence) == pytest.approx(bounded)


@pytest.mark.parametrize(
    ('cells', 'keypoints', 'expected'),
    [
        (0.0, 20.0, 20.0 / (1 - SCENES + SCENES * 20)),
        (math.log(10), 0.1, 9.1 / (1 + ALL * 9.1) * 0.1 / (1 - 0.9 * SCENES)),
        (0.0, 1e30, 1 / SCENES),  # as rarely, keypoints of another place agree as a scene
        (300.0, 1e30, 1 / ALL / SCENES),  # each witness has a bound of its own
        (300.0, 1e-30, 1e-30 / ALL),  # and keypoints may deny without one
    ],
)
def test_keypoints_have_a_bound_of_their_own(cells, keypoints, expected):
    assert ratio(cells, math.log(keypoints)) == pytest.approx(expected, rel=1e-6)


def test_the_bound_is_the_same_for_all_places_of_a_frame():
    cells, none = np.array([20.0, 17.0, 5.0, -40.0]), np.zeros(4)
    evidence = Evidence(cells, none, FAR, np.zeros(4, bool), 0.0, 0.01, 1.0, 1.0)
    first, second, third, fourth = Likelihood().log_ratios(evidence)
    assert first == pytest.approx(-math.log(ALL), abs=1e-3)
    assert first - second == pytest.approx(3, abs=1e-3)  # the cells tell them apart
    # The bound denies no place.
    assert third == pytest.approx(0) and fourth == pytest.approx(math.log(0.1))


def test_density_ratios_of_cells_are_linear_in_both_leads():
    leads = Leads(np.array([0.0, 5.0, 0.0]), np.array([0.0, 0.0, -2.0]))
    assert leads.cells.tolist() == pytest.approx([-2.0, 0.5, -3.0])


def test_leads_are_measured_against_the_strongest_and_the_best_rival():
    strengths, scores = np.array([100.0, 25.0, 16.0]), np.array([0.05, 0.042, 0.046])
    leads = Likelihood().leads(strengths, scores, np.array([False, True, True]))
    assert leads.strength.tolist() == pytest.approx([10, 0, -2])  # of twice the roots
    assert leads.score.tolist() == pytest.approx([0.5, -0.5, 0])  # in 0.008


def test_a_rival_that_shows_the_scene_has_a_share_of_it():
    strengths, scores = np.array([100.0, 64.0, 16.0]), np.array([0.05, 0.042, 0.038])
    shares = {1: 0.5, 2: 0.0}
    leads = Likelihood().leads(strengths, scores, np.array([False, True, True]), shares.get)
    # Of 64, 50 are explained, so 16 is the most that is left; of the score, half of .004.
    assert leads.strength.tolist() == pytest.approx([20 - 8, 16 - 8, 0])
    assert leads.score.tolist() == pytest.approx([0.01 / 0.008, 0.25, -0.25])


def test_no_share_is_asked_of_a_rival_that_is_beaten_anyway():
    asked = []

    def share(at):
        asked.append(at)
        return 0.1

    strengths, scores = np.array([100.0, 64.0, 49.0, 4.0]), np.array([0.2, 0.2, 0.1, 0.1])
    leads = Likelihood().leads(strengths, scores, np.array([False, True, True, True]), share)
    assert {*asked} == {1} and leads.strength[0] == pytest.approx(20 - 2 * 54**0.5)


def test_without_rivals_the_score_lead_is_relative_to_the_best_place():
    leads = Likelihood().leads(np.array([120.0, 30.0]), np.array([0.3, 0.1]), np.zeros(2, bool))
    assert leads.strength.tolist() == pytest.approx([2 * 120**0.5, 2 * 30**0.5])
    assert leads.score.tolist() == [0, -5]  # at most 5 scales


def test_the_gaps_between_rivals_are_the_scale_of_later_leads():
    strengths, rivals = np.array([100.0, 25.0, 16.0, 12.25]), np.array([False, True, True, True])
    scores = np.array([0.2, 0.10, 0.09, 0.08])
    likelihood = Likelihood()
    likelihood.learn(strengths, scores, rivals)
    later = likelihood.leads(strengths, np.array([0.11, 0.10, 0.1, 0.1]), rivals)
    # Gaps of 2 and 1 in twice the roots, of 0.01 in the scores: scales of 2 and 0.015.
    scale = (0.95 * 10 * 1.0 + 2) / 10.5
    assert later.strength[0] == pytest.approx(10 / scale)
    scale = (0.95 * 10 * 0.008 + 0.015) / 10.5
    assert later.score[0] == pytest.approx(0.01 / scale)


def test_a_strength_is_at_most_three_times_that_of_the_upper_half():
    assert strength_of(Verification(0, 100.0, 50.0)) == 100
    assert strength_of(Verification(0, 100.0, 20.0)) == 60
    assert strength_of(Verification(0, 0.0, 0.0)) == 0


def test_fewer_than_three_values_have_no_scale():
    assert gumbel_scale(np.array([3.0, 1.0])) is None
    assert gumbel_scale(np.array([3.0, 1.0, 2.0])) == pytest.approx((1 + 2) / 2)


@pytest.mark.parametrize('true', [0.1, 3.0])
def test_the_gumbel_scale_is_estimated_from_the_five_best_values(true):
    rng = np.random.default_rng(0)
    found = [gumbel_scale(np.sort(rng.gumbel(5.0, true, 200))[-5:]) for _ in range(3000)]
    assert np.mean(found) == pytest.approx(true, rel=0.1)
