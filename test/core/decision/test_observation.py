# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a frame says of places: by hand, and whatever it shows."""

import math
from types import SimpleNamespace

from convseq_ros.config import Config, with_values
from convseq_ros.core.decision.budget import BUDGET
from convseq_ros.core.decision.comparison import Comparer
from convseq_ros.core.decision.decider import Query
from convseq_ros.core.decision.expected_lead import ExpectedLead, ratios_of
from convseq_ros.core.decision.likelihood import COPIES
from convseq_ros.core.decision.observation import Observer
from convseq_ros.core.geometry.verification import Verification
from convseq_ros.core.graph.neighbourhood import Neighbourhood
from convseq_ros.core.types import Frame
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

RIVALS = {50: 0.10, 60: 0.09, 70: 0.08, 80: 0.07, 90: 0.06}
NONE = 10**9  # places from here on are of this drive: none
SHOWN = {30: 100.0}  # strength of the place that the frame shows; that of others is 25


class Pairs:
    """Stands in for a matcher: scores of pairs, and strengths of verified ones."""

    def __init__(self, scores, strengths, usual=25.0, entropy=1.0):
        self.row, self._strengths, self._usual = np.array(scores, np.float32), strengths, usual
        self.features = SimpleNamespace(packed=SimpleNamespace(side=30))
        self.descriptor = SimpleNamespace(entropy=entropy)

    def scores_of(self, requests):
        return [self.row[places] for _, places in requests]

    def rough_scores(self, _features, places):
        return self.row[places]

    def verified(self, _features, indices):
        strengths = {one: self._strengths.get(one, self._usual) for one in indices}
        return {one: Verification(0, of, of / 2, one) for one, of in strengths.items()}


class Listed:
    """Stands in for coarse scores: lists some places, and then the first that are not passed."""

    def __init__(self, places, count):
        self._places, self._count = np.array(places, np.int64), count

    def reset(self):
        """Forget nothing."""

    def update(self, _descriptor, _usable):
        """Score nothing."""

    def best(self, along, newest, passed=()):
        if not passed:
            return self._places
        there = [one for one in range(self._count) if not any(one in some for some in passed)]
        return np.array(there[: along + newest], np.int64)


class Told:
    """Stands in for keypoints: in how many blocks they agree with places; None has none."""

    def __init__(self, blocks=None):
        self._blocks, self.places = blocks, []

    def knows(self, place):
        return self._blocks is not None and self._blocks.get(place, 4) is not None

    def keypoints(self, _frame, _descriptor):
        return self._blocks

    def blocks(self, query, place, motion, side):
        assert motion == place and side == 30
        self.places.append(place)
        return query.get(place, 4)


def believing(masses=None, difference=0.0):
    """Return a belief by the mass of each place, at a difference of light."""
    masses = masses or {}
    leads = ExpectedLead(lambda places, earlier: np.where(places < earlier, difference, 0.0))
    ranked = sorted(masses, key=lambda place: -masses[place])
    places = np.array(sorted(masses), np.int64)
    return SimpleNamespace(
        places=places,
        mass=np.array([masses[place] for place in places.tolist()]),
        elsewhere=1 - sum(masses.values()),
        likeliest=lambda count: ranked[:count],
        states_at=leads.entering,
    )


def query_of(pairs, usable=None, start=NONE, config=None):
    """Return the query of the frame with these pairs."""
    buffer = SimpleNamespace(newest=pairs)
    config, usable = config or Config(), usable or len(pairs.row)
    return Query(Frame(0, None), pairs.features, buffer, usable, start, config, drive_start=start)


def scored(best=30, score=0.104, count=100, **more):
    """Return scores in which one place leads five rivals that lead all others."""
    scores = np.full(count, 0.01) - np.arange(count) / 1e5
    for one, of in (RIVALS | {best: score} | more).items():
        scores[int(one)] = of
    return scores


def looked(reference_map, pairs, masses=None, start=NONE, told=None, listed=None, usable=None,
    config=None, difference=0.0, novelty=1.0, shares=None,
):  # fmt: skip
    """Return an observation, and the log ratio of each place."""
    count = len(pairs.row)
    coarse = Listed(range(count) if listed is None else listed, count)
    near = Neighbourhood(reference_map)
    query, belief = query_of(pairs, usable, start, config), believing(masses, difference)
    compared = Comparer(coarse, pairs, near, 40).compare(query, belief.likeliest(BUDGET.peaks))
    seen = SimpleNamespace(share=lambda place, other: (shares or {}).get((place, other), 0.0))
    observer = Observer(near, told or Told(), seen)
    observation = observer.observe(query, compared, belief, novelty)
    ratios = observation.log_ratios.tolist()
    return observation, dict(zip(observation.places.tolist(), ratios, strict=True))


def ratio(reference_map, told=None, place=30, masses=None, **how):
    """Return the log ratio of a place if the frame shows place 30."""
    return looked(reference_map, Pairs(scored(), SHOWN), masses, told=told, **how)[1][place]


def test_the_place_that_the_frame_shows_gains_and_the_others_lose(a_map):
    observation, ratios = looked(a_map(100), Pairs(scored(), SHOWN))
    assert observation.has_rivals and observation.asked == {} and observation.keypoints is None
    # The place that is shown, the best rival, which leads itself by nothing, and one not verified.
    shown = [ratios[place] for place in (30, 50, 5)]
    assert shown == pytest.approx([5.432, -1.506, -2.303], abs=1e-3)
    # Places beside it are nearly as likely: they lose a quarter for each place.
    assert [ratios[place] - ratios[30] for place in (28, 29, 31, 32)] == pytest.approx(
        [-0.5, -0.25, -0.25, -0.5]
    )
    assert ratios[60] < ratios[50]


def test_the_strongest_place_of_a_large_map_lies_there_by_chance_less_often(a_map):
    pairs = Pairs(scored(), {30: 50.0})
    few, many = (looked(a_map(100), pairs, usable=usable)[1] for usable in (100, 400))
    assert few[30] + 0.5 < many[30] < few[30] + math.log(4)
    assert few[50] == many[50]


def test_a_place_that_the_belief_predicted_gains_less(a_map):
    pairs = Pairs(scored(), {30: 40.0})
    new = looked(a_map(100), pairs)[1][30]
    expected = looked(a_map(100), pairs, {29: 0.3, 60: 0.3})[1][30]
    predicted = looked(a_map(100), pairs, {29: 0.6})[1][30]
    assert new > expected + 0.5 > predicted + 0.5
    # What counts is the share of the mass in the map, not of all.
    alone = looked(a_map(100), pairs, {29: 0.3})[1][30]
    assert alone == pytest.approx(predicted)
    assert looked(a_map(100), pairs, {60: 0.6})[1][30] == new  # somewhere else


def test_keypoints_verify_the_strongest_distinct_places_and_the_likeliest_one(a_map):
    told = Told({30: 60})
    pairs = Pairs(scored(), {30: 100.0, 31: 90.0, 60: 80.0, 80: 70.0, 90: 60.0})
    observation, _ = looked(a_map(100), pairs, {50: 0.2}, told=told)
    assert told.places == [30, 60, 80, 50]
    assert [*observation.asked] == told.places
    assert observation.asked[30].lead == pytest.approx(2 * 60**0.5 - 2 * 4**0.5)
    said = observation.keypoints[:, observation.places == 30][:, 0]
    assert said == pytest.approx(ratios_of(observation.asked[30].lead))


@pytest.mark.parametrize(
    ('masses', 'strength', 'is_asked'),
    [
        ({30: 0.991}, 100.0, False),
        ({29: 0.5, 31: 0.491}, 100.0, False),
        ({80: 0.991}, 100.0, False),  # its other look
        ({30: 0.89}, 100.0, True),
        ({70: 0.95}, 100.0, True),
        ({30: 0.991}, 36.0, True),  # cells are not sure
    ],
)
def test_keypoints_are_not_used_if_belief_and_cells_are_sure(a_map, masses, strength, is_asked):
    told, whole = Told({}), a_map(65, 35)
    whole.links.add(80, 30)
    looked(whole, Pairs(scored(), {30: strength}), masses, told=told)
    assert bool(told.places) is is_asked


def test_keypoints_that_agree_raise_a_place_and_its_neighbours(a_map):
    told = Told({30: 60})
    assert ratio(a_map(100), told) > ratio(a_map(100)) + 0.1  # next to the bound
    weak = Pairs(scored(), {30: 40.0})
    cells = looked(a_map(100), weak)[1]
    both = looked(a_map(100), weak, told=told)[1]
    assert both[30] > cells[30] + 1.5 and both[32] > cells[32] + 1.5
    assert both[32] == pytest.approx(both[30] - 0.5)  # which were not asked about
    assert both[50] < cells[50] - 2.9  # asked, and they deny it
    assert both[90] == cells[90]  # not asked


@pytest.mark.parametrize('place', [30, 28])
def test_keypoints_deny_the_place_that_cells_show_only_where_they_repeat(a_map, place):
    there = Told({30: 4, 60: 80})  # the strongest by keypoints is another
    pairs = Pairs(scored(), {30: 50.0, 60: 36.0, 50: 30.0})
    cells = looked(a_map(100), pairs)[1]
    alike = looked(a_map(100), pairs, told=there)[1]
    assert cells[place] > 0.3 > 0 > alike[place] and alike[60] > cells[60] + 3
    # By other light, few of them repeat, so their silence says little.
    dark = looked(a_map(100), pairs, told=Told({}), difference=0.3)[1]
    assert cells[place] - 1.5 < dark[place] < cells[place]
    # In the running drive, light is the same.
    ours = looked(a_map(100), pairs, start=0, told=Told({}), difference=0.3)[1]
    assert ours[place] < dark[place] - 2


def test_a_place_without_keypoints_is_judged_by_cells(a_map):
    told = Told({30: None, 50: None})
    observation, ratios = looked(a_map(100), Pairs(scored(), SHOWN), told=told)
    assert [*observation.asked] == [60]
    assert ratios[30] == ratio(a_map(100)) and ratios[50] == ratio(a_map(100), place=50)


@pytest.mark.parametrize(('likeliest', 'is_asked'), [(32, False), (33, True)])
def test_keypoints_verify_the_likeliest_place_or_one_beside_it(a_map, likeliest, is_asked):
    told = Told({30: 60, 33: 20})
    pairs = Pairs(scored(), SHOWN)
    observation, _ = looked(a_map(100), pairs, {likeliest: 0.2}, told=told)
    assert (likeliest in observation.asked) is is_asked
    # Near each other, they are no rivals.
    assert observation.asked[30].lead == pytest.approx(2 * 60**0.5 - 4)


def test_keypoints_that_deny_a_place_deny_four_places_to_either_side(a_map):
    told = Told({30: 60, 50: 4})
    pairs = Pairs(scored(), {30: 100.0, 50: 90.0})
    for place, is_denied in ((46, True), (45, False)):
        masses = {30: 0.3, place: 0.2}  # place 30 is the likeliest
        before = looked(a_map(100), pairs, masses)[1]
        after = looked(a_map(100), pairs, masses, told=told)[1]
        assert (after[place] < before[place] - 2) == is_denied


def test_looks_are_no_rivals(a_map):
    whole = a_map(50, 50)
    pairs = Pairs(scored(), {30: 100.0, 80: 100.0})
    # Either may be the strongest, and leads nothing; the chance of 9 in 100 still counts.
    before = looked(whole, pairs)[1][30]
    whole.links.add(80, 30)
    assert looked(whole, pairs)[1][30] > before + 2


def test_a_rival_that_shows_the_scene_of_the_strongest_place_speaks_less_against_it(a_map):
    pairs = Pairs(scored(), {30: 100.0, 80: 90.0})
    shares = None, {(30, 80): 0.5}, {(30, 80): 1.0}, {(80, 30): 1.0}
    ratios = (looked(a_map(100), pairs, shares=some)[1][30] for some in shares)
    alone, half, whole, other_way = ratios
    assert alone + 1 < half < whole and other_way == alone


def test_no_share_is_asked_where_the_belief_is_sure_and_cells_agree(a_map):
    pairs = Pairs(scored(), {30: 100.0})
    sure = looked(a_map(100), pairs, {30: 0.9999}, shares={(30, one): 1.0 for one in RIVALS})
    assert sure[1] == looked(a_map(100), pairs, {30: 0.9999})[1]


@pytest.mark.parametrize('count', [1, 3, 12, 16])
def test_without_enough_rivals_no_place_gains(a_map, count):
    scores = np.full(count, 0.05)
    scores[0] = 0.5
    told = Told({0: 200})
    observation, ratios = looked(a_map(count), Pairs(scores, {0: 900.0}), {0: 0.5}, told=told)
    assert not observation.has_rivals and max(ratios.values()) <= 0


def test_the_first_frames_of_a_drive_are_compared_with_more_places(a_map):
    listed, counts = Listed(range(100), 100), []
    listed.best = lambda _, newest, _excluded: counts.append(newest) or np.arange(100)
    pairs = Pairs(scored(), SHOWN)
    comparer = Comparer(listed, pairs, Neighbourhood(a_map(100)), 40)
    for _ in range(BUDGET.first_frames + 1):
        comparer.compare(query_of(pairs), [])
    for begin in (comparer.reset, comparer.end_search):
        begin()
        comparer.compare(query_of(pairs), [])
    many = BUDGET.first_listed
    assert counts == [many] * BUDGET.first_frames + [10, many, 10]


def test_only_the_best_places_by_rough_score_and_predicted_ones_are_scored(a_map):
    pairs = Pairs(scored(), SHOWN)
    comparer = Comparer(Listed(range(100), 100), pairs, Neighbourhood(a_map(100)), 40)
    compared = comparer.compare(query_of(pairs), [])
    assert len(compared.places) == compared.pairs_scored == BUDGET.first_scored
    comparer.end_search()
    compared = comparer.compare(query_of(pairs), [77])
    assert compared.pairs_scored == BUDGET.scored + 1 and 77 in compared.places
    assert {30, *RIVALS} <= {*compared.places.tolist()}


def test_a_frame_without_scores_gives_no_evidence(a_map):
    observation, ratios = looked(a_map(30), Pairs(np.full(30, np.nan), {}), {3: 0.5})
    assert ratios == {3: 0.0} and not observation.has_rivals


def test_a_repeated_image_adds_no_evidence(a_map):
    pairs = Pairs(scored(), SHOWN)
    first, second = (looked(a_map(100), pairs, novelty=new)[1] for new in (1.0, 0.0))
    assert first[30] > 1 and second[30] == 0
    assert second[60] == first[60] < 0


@pytest.mark.parametrize(
    ('entropy', 'threshold', 'share'),
    [(0.0, 0.5, 0.0), (0.125, 0.5, 0.25), (0.5, 0.5, 1.0), (0.8, 0.5, 1.0), (0.0, 0.0, 1.0)],
)
def test_an_image_of_low_entropy_gives_less_evidence_for_places(a_map, entropy, threshold, share):
    config = with_values(Config(), {'entropy_threshold': threshold})
    pairs = (Pairs(scored(), SHOWN, entropy=bits) for bits in (1.0, entropy))
    whole, less = (looked(a_map(100), one, config=config)[1] for one in pairs)
    assert less[30] == pytest.approx(share * whole[30])
    assert less[60] == whole[60] < 0


@settings(max_examples=100)
@given(
    st.integers(1, 60),
    st.integers(0, 10**6),
    st.sampled_from([0.0, 1e-3, 1.0]),
    st.sampled_from([0.0, 1.0, 1e4]),
    st.one_of(st.none(), st.floats(0, 1e4)),
    st.integers(0, 60),
    st.sampled_from([0.0, 0.3, math.inf]),
)
def test_ratios_are_finite_and_bounded(a_map, count, seed, spread, most, step, start, difference):
    rng = np.random.default_rng(seed)
    scores = rng.normal(0, spread, count)
    scores[rng.random(count) < 0.2] = np.nan
    strengths = dict(enumerate(rng.uniform(0, most, count).tolist()))
    believed = rng.permutation(count)[: count // 2].tolist()
    masses = dict(zip(believed, rng.dirichlet(np.ones(len(believed))).tolist(), strict=True))
    told = Told(dict(enumerate(rng.integers(0, 257, count).tolist())))
    listed = np.sort(rng.permutation(count)[:40])
    pairs = Pairs(scores, strengths, step)
    how = start, told, listed
    observation, _ = looked(a_map(count), pairs, masses, *how, difference=difference)
    assert {*believed} <= {*observation.places.tolist()}
    assert (np.diff(observation.places) > 0).all() and np.isfinite(observation.log_ratios).all()
    assert (observation.log_ratios <= -math.log(COPIES.cells * COPIES.scenes) + 1e-9).all()
    assert observation.has_rivals or (observation.log_ratios <= 0).all()
