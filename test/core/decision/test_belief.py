# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The filter: worked by hand, and what holds of any step."""

from itertools import pairwise
import math
import tracemalloc

from convseq_ros.core.decision.belief import BELIEF, Belief
from convseq_ros.core.decision.budget import BUDGET
from convseq_ros.core.decision.expected_lead import ExpectedLead, ratios_of
from convseq_ros.core.decision.motion import MOTION, MotionModel
from convseq_ros.core.rigid import of_roll_pitch_yaw
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

NARROW = 0.1  # places; so what is moved goes to one place
COPY = 0.0005  # share of frames elsewhere that look like a place


class Driven:
    """A motion model that is told how far each velocity goes."""

    def __init__(self, *velocities, sigma=NARROW):
        self.velocities, self._sigma = np.array(velocities or (1.0,)), sigma
        self.prior = np.full(len(self.velocities), 1 / len(self.velocities))

    def reset(self):
        """Forget nothing."""

    def moved(self, places):
        moved = places + self.velocities[:, None]
        return moved, np.full(moved.shape, self._sigma)


def updated(belief, log_ratios, places=None, entry=1.0, others=0.0, earlier=0):
    """Look at some places, all of them unless told, and at what is believed."""
    places = np.arange(len(log_ratios)) if places is None else np.array(places)
    every = np.union1d(belief.places, places)
    at, ratios = np.searchsorted(every, places), np.full(len(every), others)
    ratios[at] = log_ratios
    entries = np.ones(len(every))
    entries[at] = entry
    belief.update(every, ratios, entries, len(belief._map), earlier)
    return belief


def masses(belief, count):
    """Return the mass of the first places, and of elsewhere."""
    found, there = np.zeros(count), belief.places < count
    found[belief.places[there]] = belief.mass[there]
    return found, belief.elsewhere


def in_the_dark():
    """Return the expected leads where the light of drive and map is unknown."""
    return ExpectedLead(lambda places, earlier: np.where(places < earlier, np.inf, 0.0))


def sure_of(belief, place):
    """Have a belief be sure of a place."""
    for _ in range(4):
        updated(belief, [40.0], [place], others=-40.0)
    assert belief.elsewhere == pytest.approx(COPY, rel=1e-2)
    return belief


def test_the_second_prediction_and_update_have_the_masses_worked_by_hand(a_map):
    belief = Belief(a_map(4), Driven(), in_the_dark())
    first = updated(belief, np.log([1, 20, 1, 1])).mass
    belief.predict(4, 4)
    mass, elsewhere = masses(belief, 4)
    # All move on by one; the last runs off the map, and of each a two-thousandth leaves it.
    prior = (1 - 0.0005) * np.array([0, *first[:3]])
    assert mass == pytest.approx(prior) and elsewhere == pytest.approx(1 - prior.sum())
    updated(belief, np.log([1, 1, 20, 1]), entry=[1, 1, 0.5, 0])
    # A small share is at copies of places, which are elsewhere; of these, four in a thousand end.
    copies = (1 - 0.0005) * 0.996 * COPY / (1 - COPY) * np.array([0, *first[:3]])
    # What ran off the map is lost; without earlier drives, it does not enter.
    apart = elsewhere - copies.sum()
    entering = 0.004 * (apart - first[3] / (1 - COPY))
    share, stays = (entering * np.array([1, 1, 0.5, 0]) + 5e-4) / 4, apart - entering
    weights = (prior + (1 - COPY) * share) * [1, 1, 20, 1]
    copies = (copies + COPY * share) * [1, 1, 20, 1]
    total = weights.sum() + copies.sum() + stays
    mass, left = masses(belief, 4)
    assert mass == pytest.approx(weights / total)
    assert left == pytest.approx((stays + copies.sum()) / total)


def test_answers_move_mass_between_true_places_and_copies(a_map):
    leads = ExpectedLead(lambda places, _: np.zeros(len(places)))
    belief = Belief(a_map(4), Driven(0.0), leads)
    updated(belief, np.log([1, 20, 1, 1]), earlier=4)
    before, elsewhere = masses(belief, 4)
    said = np.ones((6, 4))
    said[:, 1] = ratios_of(0.0)  # at place 1, keypoints lead by nothing
    states = belief.states_at(np.array([1]), 4)[:, 0]
    assert states == pytest.approx(leads.entering(np.array([1]), 4)[:, 0])
    belief.predict(4, 4)
    moved = leads.moved(states[:, None], np.array([1]), 4, BELIEF.entering)[:, 0]
    shares = moved * said[:, 1] / (moved @ said[:, 1])
    log_ratios = np.array([0, math.log(moved @ said[:, 1] / moved.sum()), 0, 0])
    belief.update(belief.places, log_ratios, np.zeros(4), 4, 4, said)
    assert belief.states_at(np.array([1]), 4)[:, 0] == pytest.approx(shares, rel=1e-2)
    mass, left = masses(belief, 4)
    assert mass[1] < 0.05 * before[1] and left > elsewhere
    assert belief.expected_leads(belief.places == 1).sum() == pytest.approx(mass[1])
    assert belief.elsewhere + belief.mass.sum() == pytest.approx(1)


def test_a_place_without_mass_has_the_states_of_entering_mass(a_map):
    leads = in_the_dark()
    belief = Belief(a_map(4), Driven(), leads)
    expected = leads.entering(np.array([1, 3]), 2)
    assert belief.states_at(np.array([1, 3]), 2) == pytest.approx(expected)


def test_a_lost_robot_is_in_an_earlier_map_with_probability_one_half(a_map):
    def first_mass(count, earlier):
        belief = Belief(a_map(count), Driven(), in_the_dark())
        return updated(belief, np.zeros(count), earlier=earlier).mass.sum()

    assert first_mass(1000, 1000) == pytest.approx((1 - COPY) * 0.5, abs=5e-4)
    assert first_mass(100, 100) == pytest.approx(100 * COPY, abs=1e-3)  # no frame decides
    assert first_mass(100, 0) == pytest.approx((1 - COPY) * 5e-4, rel=0.01)  # of no earlier drive
    belief = updated(Belief(a_map(400), Driven(), in_the_dark()), np.full(400, -40.0), earlier=400)
    later = updated(belief, np.zeros(400), earlier=400).mass.sum()
    assert later == pytest.approx(0.004 + 5e-4, abs=2e-4)  # the first frame denies all places


def test_half_of_the_mass_is_where_others_say_and_the_other_half_stays_lost(a_map):
    belief = Belief(a_map(40), Driven(0.0), in_the_dark())
    belief.expect(np.array([3, 4]), np.array([0.75, 0.25]), 40)
    found, elsewhere = masses(belief, 5)
    assert found[3:] == pytest.approx([0.375 * (1 - COPY), 0.125 * (1 - COPY)])
    assert found.sum() + elsewhere == pytest.approx(1.0)
    belief.predict(40, 40)
    # What is lost enters all 40 places, as at a start: at most COPY at each.
    found, _ = masses(updated(belief, [0.0] * 40, earlier=40), 40)
    assert found[20] == pytest.approx(0.5 * COPY, rel=0.3) and found[3] > 100 * found[20]


def test_mass_that_runs_off_a_session_may_be_anywhere_in_the_map(a_map):
    belief = sure_of(Belief(a_map(1000, 4), Driven(), in_the_dark()), 1003)
    belief.predict(1004, 1004)
    assert belief.elsewhere > 0.99
    updated(belief, np.zeros(1004), earlier=1004)
    assert belief.mass.sum() == pytest.approx(0.5, abs=0.01)


def test_what_runs_off_the_end_of_an_earlier_drive_goes_on_where_its_last_scene_is_seen(a_map):
    asked = []

    def onward(last, earlier):
        asked.append((last, earlier))
        return np.array([2, 5]), np.array([0.6, 0.2])

    belief = sure_of(Belief(a_map(20), Driven(), in_the_dark(), onward), 19)
    belief.predict(20, 20)
    found, elsewhere = masses(belief, 20)
    # No more than the largest share goes on, by the shares.
    assert found[[2, 5]] == pytest.approx([0.45, 0.15], rel=0.01)
    assert elsewhere == pytest.approx(0.4, rel=0.01) and asked == [(19, 20)]
    assert found.sum() + elsewhere == pytest.approx(1)
    # The rest is lost, and may be anywhere.
    assert updated(belief, np.zeros(20), earlier=20).mass.sum() == pytest.approx(0.6, abs=0.02)
    # A drive that goes on has no end; what is nearly nothing is not asked about.
    running = sure_of(Belief(a_map(20), Driven(), in_the_dark(), onward), 19)
    running.predict(20, 10)
    assert running.elsewhere > 0.99
    sure_of(Belief(a_map(20), Driven(), in_the_dark(), onward), 3).predict(20, 20)
    assert asked == [(19, 20)]


def test_a_small_share_of_the_mass_changes_its_velocity(a_map):
    belief = Belief(a_map(20), Driven(1.0, 3.0), in_the_dark())
    sure_of(belief, 2)
    belief.predict(20, 20)
    updated(belief, [40.0], [5], others=-40.0)  # it was three
    assert belief.velocity(5) == 3.0 and belief.velocity(12) == 1.0
    belief.predict(20, 20)
    mass, _ = masses(belief, 20)
    assert mass[8] == pytest.approx(1, abs=0.01)
    belief.predict(20, 20)
    changed = MOTION.changing / 2
    assert masses(belief, 20)[0][9] == pytest.approx(changed, rel=0.1)


def test_a_robot_in_reverse_gear_is_followed_though_neighbours_match_too(a_map):
    street = a_map(60)
    belief = Belief(street, MotionModel(street, both=False, way_error=0.1), in_the_dark())
    for place in range(50, 10, -1):
        belief.predict(60, 60)
        updated(belief, 6.0 - 0.25 * abs(np.arange(60) - place))
        (likeliest,) = belief.likeliest(1)
        assert abs(likeliest - place) <= (4 if place > 40 else 1)


def test_the_likeliest_places_come_in_order_of_mass(a_map):
    belief = Belief(a_map(6), Driven(), in_the_dark())
    updated(belief, np.log([5, 450, 5, 300, 0.05, 5]))
    assert belief.likeliest(2) == [1, 3] and belief.likeliest(9) == [1, 3, 0, 2, 5, 4]


def test_mass_beyond_the_end_of_a_session_or_of_usable_places_goes_elsewhere(a_map):
    for place, usable in ((4, 10), (9, 10), (6, 7)):
        belief = sure_of(Belief(a_map(5, 5), Driven(), in_the_dark()), place)
        belief.predict(usable, usable)
        assert belief.elsewhere == pytest.approx(1, abs=1e-3)
        assert place + 1 not in belief.places


def test_a_tenth_of_a_places_mass_moves_on_from_its_looks(a_map):
    whole = a_map(30, 30)
    whole.links.add(45, 10)
    # 2 to 18 are looks of 45; it is one of all of them.
    looks = whole.links.looks(45)
    belief = sure_of(Belief(whole, Driven(), in_the_dark()), 45)
    belief.predict(60, 60)
    mass, _ = masses(belief, 60)
    assert mass[46] == pytest.approx(0.9 * (1 - COPY), abs=2e-3)
    assert mass[[one + 1 for one in looks]] == pytest.approx(0.1 / len(looks), rel=0.01)
    belief = sure_of(Belief(whole, Driven(), in_the_dark()), 45)
    belief.predict(46, 46)  # looks that may not be matched get nothing; those before do
    assert masses(belief, 60)[0][[one + 1 for one in looks]].sum() == pytest.approx(0.1, rel=0.01)
    belief = sure_of(Belief(whole, Driven(), in_the_dark()), 10)
    belief.predict(45, 45)  # 45 is the first that may not be matched
    assert masses(belief, 60)[0][11] == pytest.approx(1, abs=3e-3)


def test_repeated_denial_moves_the_belief_elsewhere_step_by_step(a_map):
    belief = sure_of(Belief(a_map(20), Driven(0.0), in_the_dark()), 7)
    left = [belief.elsewhere]
    for _ in range(12):
        belief.predict(20, 20)
        left.append(updated(belief, np.full(20, -1.0), others=-1.0).elsewhere)
    assert all(one < other for one, other in pairwise(left)) and left[-1] > 0.9


def test_the_belief_recovers_from_the_lowest_likelihoods(a_map):
    belief = Belief(a_map(20), Driven(0.0), in_the_dark())
    for _ in range(50):
        updated(belief, np.full(20, -50.0), others=-50.0)
    assert belief.elsewhere == pytest.approx(1)
    for _ in range(3):
        updated(belief, [6.0, *[-2.0] * 19])
    assert belief.mass[0] > 0.9


LENGTHS = st.lists(st.integers(1, 12), min_size=1, max_size=4)
STEPS = st.lists(
    st.tuples(
        st.integers(0, 10**6),  # the seed of what is looked at
        st.sampled_from([-50.0, -2.0, 0.0, 6.5, 50.0]),
        st.one_of(st.none(), st.floats(-30, 30)),  # where odometry is
    ),
    min_size=1,
    max_size=8,
)


def driven(whole, steps, both, order=None, most=50.0, looked=0.6):
    """Yield a belief after each prediction and each update; places renumbered by an order."""
    order = np.arange(len(whole)) if order is None else order
    belief = Belief(whole, MotionModel(whole, both, 0.05), in_the_dark())
    for seed, extreme, x in steps:
        pose = None if x is None else of_roll_pitch_yaw((x, 0.0, 0.0), 0.0, 0.0, 0.0)
        belief.motion.move(pose, 0)
        belief.predict(len(whole), len(whole))
        yield belief
        rng = np.random.default_rng(seed)
        ratios, entry = rng.uniform(-most, most, len(order)), rng.uniform(0, 1, len(order))
        ratios[rng.random(len(order)) < 0.4] = np.clip(extreme, -most, most)
        there = order[rng.random(len(order)) < looked]
        places = np.union1d(there, belief.places)
        old = np.argsort(order)[places]
        belief.update(places, ratios[old], entry[old], len(whole), len(whole))
        yield belief


@settings(max_examples=80)
@given(LENGTHS, STEPS, st.booleans(), st.sampled_from([None, 1.0]), st.integers(0, 99))
def test_mass_stays_a_distribution_for_any_input(a_map, lengths, steps, both, step_m, seed):
    whole = a_map(*lengths, step_m=step_m)
    rng = np.random.default_rng(seed)
    for place in range(1, len(whole)):
        if rng.random() < 0.3:
            whole.links.add(place, int(rng.integers(place)))
    for belief in driven(whole, steps, both):
        assert np.isfinite(belief.mass).all() and (belief.mass >= 0).all()
        assert 0 <= belief.elsewhere <= 1
        assert belief.mass.sum() + belief.elsewhere == pytest.approx(1, abs=1e-6)
        places = belief.places
        assert (np.diff(places) > 0).all() and set(places.tolist()) <= set(range(len(whole)))


@settings(max_examples=60)
@given(st.integers(1, 12), st.integers(1, 12), STEPS, st.booleans(), st.sampled_from([None, 1.0]))
def test_the_order_of_sessions_makes_no_difference(a_map, one, other, steps, both, step_m):
    swapped = np.array([*range(other, other + one), *range(other)])
    firsts = driven(a_map(one, other, step_m=step_m), steps, both, None, 7.0, 1.0)
    seconds = driven(a_map(other, one, step_m=step_m), steps, both, swapped, 7.0, 1.0)
    for first, second in zip(firsts, seconds, strict=True):
        mass, elsewhere = masses(first, one + other)
        found, left = masses(second, one + other)
        # Half a place is rounded to an even one, so tails end at another place.
        assert found[swapped] == pytest.approx(mass, abs=3e-3)
        assert left == pytest.approx(elsewhere, abs=3e-3)


@pytest.mark.parametrize(('least', 'held'), [(1.5 * BUDGET.least, 17), (1e-5, 5000)])
def test_a_prediction_takes_little_memory_however_many_places_have_mass(a_map, least, held):
    count, velocities = 5000, np.linspace(-6, 6, 18)
    belief = Belief(a_map(count), Driven(*velocities, sigma=0.8), in_the_dark())
    belief.places = np.arange(count)
    belief._mass = np.full((18, count), least)
    belief._mass[:, 7] = 0.01
    belief._states = np.tile(belief._mass.sum(axis=0) / 6, (6, 1))
    tracemalloc.start()
    try:
        belief.predict(count, 0)
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 1200 * count and len(belief.places) == held
