# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What keypoints say, and how far they are expected to lead: worked by hand."""

import math
from statistics import NormalDist

from convseq_ros.core.decision.expected_lead import ExpectedLead, keypoint_ratios, ratios_of
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

EXPECTED = (0, 2, 4, 6, 8)
COPY = 0.0005  # share of the mass that enters at a copy
ENDING = 0.004  # share of copies, per step
LEAST = 2 * 2**0.5  # twice the root of the blocks that chance gives
NEW, OURS, EARLIER = np.array([3]), np.array([7]), 5  # a place of an earlier drive, of this one


def first(likeliest):
    """Return probabilities that fall by e for each 0.8 from the likeliest lead."""
    shares = np.array([math.exp(-abs(one - likeliest) / 0.8) for one in EXPECTED])
    return shares / shares.sum()


def said(lead, likeliest):
    """Return the log ratio of a lead: normal about an expected one, or about 0 elsewhere."""
    elsewhere = NormalDist(0, 1.6).pdf(lead)
    ratios = [1.0, *(NormalDist(one, 1.23).pdf(lead) / elsewhere for one in EXPECTED[1:])]
    return math.log((1 - COPY) * (first(likeliest) @ ratios) + COPY)


def expected_lead(difference=math.inf):
    """Return the expected leads at a difference of light from that of earlier drives."""
    return ExpectedLead(lambda places, earlier: np.where(places < earlier, difference, 0.0))


def of(leads, place):
    """Return the probabilities of the expected leads at a place."""
    return leads.probabilities(place, EARLIER)[:, 0]


def asked(blocks, difference=0.0, near=()):
    """Return what keypoints say of places, of which two may be near each other."""
    entering = expected_lead(difference).entering(NEW, EARLIER)[:, 0]
    states = dict.fromkeys(blocks, entering)
    return keypoint_ratios(blocks, states, lambda *places: {*places} == {*near})


def test_a_places_keypoints_lead_those_of_the_others_or_the_chance_level():
    both = asked({1: 25, 2: 9})  # twice the roots: 10 and 6
    assert (both[1].lead, both[2].lead) == (4, -4)
    assert both[1].ratio == pytest.approx(said(4, 6))
    assert both[2].ratio == pytest.approx(said(-4, 6)) and both[2].ratio < -5.9
    few, alone = asked({1: 25, 2: 1}), asked({1: 25})
    assert few[1].ratio == alone[1].ratio == pytest.approx(said(10 - LEAST, 6))
    assert asked({}) == {}


@pytest.mark.parametrize(
    ('difference', 'likeliest'), [(0.0, 6), (0.15, 4), (0.3, 2), (0.9, 0), (math.inf, 0)]
)
def test_the_expected_lead_falls_with_the_light_but_on_the_running_drive(difference, likeliest):
    leads = expected_lead(difference)
    assert of(leads, NEW) == pytest.approx(first(likeliest))
    assert of(leads, OURS) == pytest.approx(first(6))
    ratio = asked({1: 25}, difference=difference)[1].ratio
    assert ratio == pytest.approx(said(10 - LEAST, likeliest))


def test_two_places_that_both_exceed_chance_are_no_rivals():
    alone = asked({1: 25})[1].ratio
    over = next(n for n in range(25) if asked({2: n})[2].ratio > 3)
    assert asked({1: 25, 2: over})[1].ratio == alone
    assert asked({1: 25, 2: over})[2].ratio == asked({2: over})[2].ratio
    lead = 10 - 2 * (over - 1) ** 0.5
    assert asked({1: 25, 2: over - 1})[1].ratio == pytest.approx(said(lead, 6))


def test_places_near_each_other_are_no_rivals():
    three = asked({1: 9, 2: 8, 3: 7}, near=(1, 3))  # none leads over chance enough
    for place, blocks, of_rival in ((1, 9, 8), (2, 8, 9), (3, 7, 8)):
        assert three[place].lead == pytest.approx(2 * blocks**0.5 - 2 * of_rival**0.5)


def test_a_small_share_of_the_entering_mass_is_at_a_copy():
    shares = expected_lead().entering(np.r_[OURS, NEW], EARLIER)
    assert shares.sum(axis=0) == pytest.approx([1, 1])
    assert shares[-1] == pytest.approx([COPY, COPY])
    assert shares[:-1, 0] == pytest.approx((1 - COPY) * first(6))  # of the running drive
    assert shares[:-1, 1] == pytest.approx((1 - COPY) * first(0))  # of unknown light


def test_a_tenth_of_the_mass_changes_its_expected_lead_and_some_copies_end():
    leads = expected_lead()
    states = np.array([[0.5, 0, 0, 0, 0, 0.25]]).T
    moved = leads.moved(states, OURS, EARLIER, ENDING)[:, 0]
    assert moved[:-1] == pytest.approx(0.5 * (0.9 * np.array([1, 0, 0, 0, 0]) + 0.1 * first(6)))
    assert moved[-1] == pytest.approx(0.996 * 0.25)
    dark = leads.moved(states, NEW, EARLIER, ENDING)[0, 0]  # in other light, keypoints stay silent
    assert dark == pytest.approx(0.5 * (0.9 + 0.1 * first(0)[0]))


def test_the_last_match_has_a_weight_of_one_tenth():
    leads, four = expected_lead(), np.array([0.0, 0.0, 0.5, 0.0, 0.0])
    leads.learn(four, OURS[0], EARLIER)
    expected = 0.9 * first(6) + [0, 0, 0.1, 0, 0]
    expected[0] = first(6)[0]  # the least probable at first
    assert of(leads, OURS) == pytest.approx(expected, rel=1e-3)
    assert of(leads, NEW) == pytest.approx(first(0))
    leads.reset()
    assert of(leads, OURS) == pytest.approx(first(6))


SILENT = np.array([0.7, 0.1, 0.0, 0.0, 0.0])


def test_silent_matches_teach_silence_on_places_of_earlier_drives_alone():
    leads = expected_lead(0.05)  # as by noon on a map of the afternoon: shadows moved
    assert of(leads, NEW)[0] < 0.01
    for _ in range(30):
        leads.learn(SILENT, NEW[0], EARLIER)
    assert of(leads, NEW)[0] > 0.8 and of(leads, OURS) == pytest.approx(first(6))
    for _ in range(100):
        leads.learn(SILENT, OURS[0], EARLIER)
    assert of(leads, OURS)[0] <= 1.2 * first(6)[0]


def test_a_silent_lead_keeps_its_probability_after_a_thousand_matches():
    leads = expected_lead()
    for _ in range(1000):
        leads.learn(np.array([0.0, 0.0, 0.0, 0.9, 0.0]), OURS[0], EARLIER)
    learned = of(leads, OURS)
    assert learned[[0, 1, 2, 4]] == pytest.approx(first(6)[0], rel=0.01)
    assert learned.sum() == pytest.approx(1)


def test_what_is_learned_by_day_does_not_hold_at_night():
    light = {'difference': 0.0}
    leads = ExpectedLead(lambda places, _: np.full(len(places), light['difference']))
    for _ in range(100):
        leads.learn(np.array([0.0, 0.0, 0.1, 0.8, 0.1]), NEW[0], EARLIER)
    by_day = of(leads, NEW)
    assert by_day[0] < 0.002 and by_day[3] > 0.75
    light['difference'] = 1.0
    assert of(leads, NEW)[0] > 0.8  # keypoints are silent again
    light['difference'] = 0.0
    assert of(leads, NEW) == pytest.approx(by_day)


def test_ratios_of_a_lead_are_those_worked_by_hand():
    # 1.6 / 1.23 = 1.301 times e to the power of (x / 1.6)^2 / 2 - ((x - u) / 1.23)^2 / 2.
    assert ratios_of(0.0) == pytest.approx([1, 0.3468, 6.57e-3, 8.86e-6, 8.49e-10, 1], rel=2e-3)
    assert ratios_of(4.0)[[0, 2, 5]] == pytest.approx([1, 29.61, 1], rel=1e-3)


@given(st.floats(-40, 40), st.floats(0, 2), st.floats(0, 1))
def test_keypoints_never_deny_a_copy(lead, difference, share):
    leads = expected_lead(difference)
    states = share * leads.entering(NEW, EARLIER)
    after = leads.moved(states, NEW, EARLIER, ENDING) * ratios_of(lead)[:, None]
    assert np.isfinite(after).all() and (after >= 0).all()
    assert after[-1, 0] == pytest.approx(0.996 * COPY * share)
