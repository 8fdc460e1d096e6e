# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The likelihood ratio, worked by hand."""

import math

from convseq_ros.core.decision.likelihood import (
    Asked,
    doubts,
    Evidence,
    gumbel_scale,
    Leads,
    Likelihood,
    strength_of,
)
from convseq_ros.core.geometry.verification import Verification
import numpy as np
import pytest

ALL = 0.0015  # share of frames elsewhere that look like a place in every respect


def ratio(
    cells=0.0, keypoints=0.0, is_strongest=False, follows=0.0, chance=0.01, affirmed=1.0, seen=None
):
    """Return the likelihood ratio of a place."""
    place = np.array([cells]), np.array([keypoints]), np.array([is_strongest])
    evidence = Evidence(*place, follows, chance, affirmed)
    return math.exp((seen or Likelihood()).log_ratios(evidence)[0])


def bounded(value):
    return value / (1 + ALL * value)


@pytest.mark.parametrize(
    ('evidence', 'expected'),
    [
        ({}, 1.0),
        ({'cells': math.log(10)}, 0.86 * 10 + 0.14),
        ({'cells': -40.0}, 0.14),  # cells may fail to show a true place
        # The strongest place of a drive elsewhere lies anywhere: 1 in 100 here.
        ({'is_strongest': True}, 0.86 * 100 + 0.14),
        ({'is_strongest': True, 'chance': 0.5}, 0.86 * 2 + 0.14),
        # If the belief predicted it: as a copy would, in 30 % of drives past copies.
        ({'is_strongest': True, 'follows': 1.0}, 0.86 / 0.31 + 0.14),
        ({'is_strongest': True, 'follows': 0.5}, 0.86 / 0.16 + 0.14),
        ({'is_strongest': True, 'follows': 1.0, 'chance': 1.0}, 1.0),
        # Keypoints that deny make a copy likelier; those that affirm are counted by themselves.
        (
            {'is_strongest': True, 'follows': 1.0, 'affirmed': 0.1},
            0.86 / (0.3 / 0.37 + 0.01) + 0.14,
        ),
        ({'is_strongest': True, 'follows': 1.0, 'affirmed': 50.0}, 0.86 / 0.31 + 0.14),
        ({'follows': 1.0, 'affirmed': 0.1}, 1.0),  # of another place
        ({'keypoints': math.log(20)}, 20.0),
        ({'cells': math.log(10), 'keypoints': math.log(0.1)}, 0.874),
        ({'cells': 300.0, 'keypoints': 20.0, 'is_strongest': True}, 1e100),
    ],
)
def test_a_ratio_by_hand(evidence, expected):
    assert ratio(**evidence) == pytest.approx(bounded(expected))


def test_density_ratios_of_cells_are_linear_in_both_leads():
    leads = Leads(np.array([0.0, 5.0, 0.0]), np.array([0.0, 0.0, -2.0]))
    assert leads.cells.tolist() == pytest.approx([-0.7, 1.3, -1.7])


def test_leads_are_over_the_strongest_and_the_best_rival():
    strengths, scores = np.array([100.0, 25.0, 16.0]), np.array([0.05, 0.042, 0.046])
    leads = Likelihood().leads(strengths, scores, np.array([False, True, True]))
    assert leads.strength.tolist() == pytest.approx([10, 0, -2])  # of twice the roots
    assert leads.score.tolist() == pytest.approx([0.5, -0.5, 0])  # in 0.008


def test_without_rivals_a_place_leads_unrelated_images():
    leads = Likelihood().leads(np.array([120.0, 30.0]), np.array([0.3, 0.1]), np.zeros(2, bool))
    assert leads.strength.tolist() == pytest.approx([2 * (120**0.5 - 30**0.5), 0])
    assert leads.score.tolist() == [0, -5]  # at most 5 scales


def test_the_gaps_between_rivals_are_the_scale_of_later_leads():
    strengths, rivals = np.array([100.0, 25.0, 16.0, 12.25]), np.array([False, True, True, True])
    scores = np.array([0.2, 0.10, 0.09, 0.08])
    likelihood = Likelihood()
    likelihood.leads(strengths, scores, rivals)
    later = likelihood.leads(strengths, np.array([0.11, 0.10, 0.1, 0.1]), rivals)
    # Gaps of 2 and 1 in twice the roots, of 0.01 in the scores: scales of 2 and 0.015.
    scale = (0.95 * 10 * 1.0 + 2) / 10.5
    assert later.strength[0] == pytest.approx(10 / scale**0.7)
    scale = (0.95 * 10 * 0.008 + 0.015) / 10.5
    assert later.score[0] == pytest.approx(0.01 / (scale**0.7 * 0.008**0.3))


def test_the_chance_that_cells_work_is_learned_from_matches():
    missed, shown = Likelihood(), Likelihood()
    missed.confirm(False, None)
    shown.confirm(True, None)
    assert missed.cells_work == pytest.approx(1 - (0.95 * 1.4 + 1) / 10.5)
    assert shown.cells_work == pytest.approx(1 - 0.95 * 1.4 / 10.5)
    assert ratio(-40.0, seen=missed) == pytest.approx(bounded(1 - missed.cells_work))
    assert shown.unverified == pytest.approx(math.log(0.95 * 1.4 / 10.5))
    for _ in range(200):
        shown.confirm(True, None)
    assert shown.cells_work == 0.98
    shown.reset()
    assert shown.cells_work == pytest.approx(0.86)


NEW = {1: False, 2: False}  # places of earlier drives
OURS = {1: True, 2: True}  # of the running one


def test_keypoints_of_a_place_lead_those_of_the_others_or_what_chance_gives():
    both = Likelihood().asked({1: 25, 2: 9}, NEW)  # twice the roots: 10 and 6
    assert (both[1].root, both[2].root) == (10, 6)
    assert both[1].ratio == pytest.approx(1.1 * (4 - 2.6))
    assert both[2].ratio == pytest.approx(1.1 * (-4 - 2.6))
    few = Likelihood().asked({1: 25, 2: 4}, NEW)
    alone = Likelihood().asked({1: 25}, NEW)
    assert few[1].ratio == alone[1].ratio == pytest.approx(1.1 * (10 - 2 * 7**0.5 - 2.6))
    assert Likelihood().asked({}, {}) == {}


def test_two_places_with_as_many_blocks_as_matches_have_are_no_rivals():
    likelihood = Likelihood()
    likelihood.confirm(True, Asked(10.0, 0.0, False))  # 25 blocks
    against_chance = likelihood.asked({1: 25}, NEW)[1].ratio
    assert likelihood.asked({1: 25, 2: 13}, NEW)[1].ratio == against_chance
    assert likelihood.asked({1: 25, 2: 13}, NEW)[2].ratio < against_chance
    assert likelihood.asked({1: 25, 2: 12}, NEW)[1].ratio < against_chance  # fewer than half
    # Places of the running drive have more in common with it; their number is another.
    assert likelihood.asked({1: 25, 2: 13}, OURS)[1].ratio < against_chance
    for _ in range(50):
        likelihood.confirm(True, Asked(20.0, 0.0, False))
    assert likelihood.asked({1: 25, 2: 13}, NEW)[1].ratio < against_chance


def said(answer_ratio, is_alike, is_current=False, seen=None):
    """Return the ratio of a place by keypoints."""
    answer = Asked(0.0, answer_ratio, is_current)
    return math.exp((seen or Likelihood()).keypoints(answer, is_alike))


def test_keypoints_are_silent_as_far_as_they_do_not_repeat():
    assert said(math.log(10), True) == pytest.approx(0.95 * 10 + 0.05)
    assert said(math.log(10), False) == pytest.approx(0.2 * 10 + 0.8)
    assert said(-40.0, True) == pytest.approx(0.05)
    assert said(-40.0, False) == pytest.approx(0.8)
    assert said(-40.0, False, is_current=True) == pytest.approx(0.05)


def test_a_surprising_lead_shows_that_keypoints_repeat():
    likelihood = Likelihood()
    likelihood.learn_repeats({}, False)
    likelihood.learn_repeats({1: Asked(9.0, 2.9, False)}, False)  # as chance gives
    assert said(-40.0, False, seen=likelihood) == pytest.approx(0.8)
    likelihood.learn_repeats({1: Asked(9.0, 3.1, False), 2: Asked(5.0, -9.0, True)}, False)
    assert said(-40.0, False, seen=likelihood) == pytest.approx(1 - 0.28)
    assert said(-40.0, False, True, seen=likelihood) == pytest.approx(0.05)  # not of those
    assert said(-40.0, True, seen=likelihood) == pytest.approx(0.05)  # never less than at first
    for _ in range(200):
        likelihood.learn_repeats({1: Asked(9.0, 3.1, False)}, False)
    assert said(-40.0, False, seen=likelihood) == pytest.approx(0.005)
    likelihood.reset()
    assert said(-40.0, False, seen=likelihood) == pytest.approx(0.8)


def test_a_weak_place_of_the_running_drive_is_doubted():
    strengths, step = np.array([60.0, 20.0, 150.0]), Verification(0, 200.0, 100.0)
    ours = doubts(strengths, np.ones(3, bool), step)  # 60 is half of 0.6 of the step's
    assert ours.tolist() == pytest.approx([2.5 * math.log(0.5), -2.0, 0.0])
    assert not doubts(strengths, np.zeros(3, bool), step).any()
    assert not doubts(strengths, np.ones(3, bool), None).any()


def test_a_strength_is_at_most_three_times_that_of_the_upper_half():
    assert strength_of(Verification(0, 100.0, 50.0)) == 100
    assert strength_of(Verification(0, 100.0, 20.0)) == 60
    assert strength_of(Verification(0, 0.0, 0.0)) == 15


def test_fewer_than_three_values_have_no_scale():
    assert gumbel_scale(np.array([3.0, 1.0])) is None
    assert gumbel_scale(np.array([3.0, 1.0, 2.0])) == pytest.approx((1 + 2) / 2)


@pytest.mark.parametrize('true', [0.1, 3.0])
def test_a_scale_is_that_of_what_the_best_were_drawn_from(true):
    rng = np.random.default_rng(0)
    found = [gumbel_scale(np.sort(rng.gumbel(5.0, true, 200))[-5:]) for _ in range(3000)]
    assert np.mean(found) == pytest.approx(true, rel=0.1)
