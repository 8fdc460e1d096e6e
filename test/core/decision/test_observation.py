# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a frame says of places: by hand, and whatever it shows."""

from convseq_ros.core.decision.likelihood import gumbel_scale, RATIO
from convseq_ros.core.decision.observation import Neighbourhood, Observer
from convseq_ros.core.geometry.verification import Verification
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

RIVALS = {50: 0.10, 60: 0.09, 70: 0.08, 80: 0.07, 90: 0.06}
NONE = 10**9  # places from here on are of this drive: none


class Frame:
    """Stands in for a buffer: what pairs score, and how strongly they are verified."""

    def __init__(self, scores, strengths, step=None, usual=25.0):
        self.rows, self._strengths, self._usual = [np.array(scores, np.float32)], strengths, usual
        self.verified_step = None if step is None else shown(step)
        self.asked, self.scored, self.novelty = set(), (), 1.0

    def score(self, count, places):
        assert count == 1
        self.scored = (*self.scored, *places.tolist())

    def rough_scores(self, places):
        return self.rows[0][places]

    def verified(self, indices):
        self.asked |= {*indices}
        return {one: shown(self._strengths.get(one, self._usual)) for one in indices}


class Listed:
    """Stands in for coarse scores: lists some places, and then the first that are not passed."""

    def __init__(self, places, count):
        self._places, self._count = np.array(places, np.int64), count

    def reset(self):
        """Forget nothing."""

    def best(self, along, newest, passed=()):
        if not passed:
            return self._places
        there = [one for one in range(self._count) if not any(one in some for some in passed)]
        return np.array(there[: along + newest], np.int64)


def shown(strength, upper=None):
    return Verification(0, strength, strength / 2 if upper is None else upper)


def scored(best=30, score=0.104, count=100, **more):
    """Return scores in which one place leads five rivals that lead all others."""
    scores = np.full(count, 0.01) - np.arange(count) / 1e5
    for one, of in (RIVALS | {best: score} | more).items():
        scores[int(one)] = of
    return scores


def looked(
    reference_map, frame, predicted=(), start=NONE, listed=None, learned=None, believed=None
):
    """Return an observation, and the log ratio of each place."""
    count = len(frame.rows[0])
    coarse = Listed(range(count) if listed is None else listed, count)
    observer = Observer(coarse, Neighbourhood(reference_map), 40)
    for strength in learned or ():
        observer.likelihood.learn(strength, False)
    believed = np.array(sorted(predicted) if believed is None else believed, np.int64)
    seen = observer.observe(frame, believed, predicted, start)
    return seen, dict(zip(seen.places.tolist(), seen.log_ratios.tolist(), strict=True))


def test_looks_are_no_rivals(a_map):
    whole = a_map(50, 50)
    frame = Frame(scored(), {30: 100.0, 80: 100.0})
    assert looked(whole, frame)[1][30] < 0  # the other one is shown as well
    whole.links.add(80, 30)
    _, ratios = looked(whole, Frame(scored(), {30: 100.0, 80: 100.0}))
    assert ratios[30] > 0


@pytest.mark.parametrize('count', [1, 3, 12, 16])
def test_without_enough_other_places_nothing_speaks_for_one(a_map, count):
    scores = np.full(count, 0.05)
    scores[0] = 0.5
    seen, ratios = looked(a_map(count), Frame(scores, {0: 900.0}))
    assert not seen.has_rivals and max(ratios.values()) <= 0


def test_a_frame_without_scores_says_nothing(a_map):
    seen, ratios = looked(a_map(30), Frame(np.full(30, np.nan), {}), [3])
    assert ratios == {3: 0.0} and not seen.has_rivals


def test_a_place_of_this_drive_is_compared_with_the_frame_before(a_map):
    def ratio(step, start):
        return looked(a_map(100), Frame(scored(), {30: 100.0}, step), start=start)[1][30]

    assert ratio(600.0, 0) < 0 < ratio(150.0, 0)
    assert ratio(600.0, NONE) == ratio(600.0, 31) == ratio(150.0, 0)


def test_as_strong_as_matches_are_is_another_hypothesis_and_no_control(a_map):
    # Two places are shown as matches of this drive are: neither is a reason against the other.
    strengths = {30: 420.0, 60: 400.0}
    before = looked(a_map(100), Frame(scored(), strengths))[1]
    ratios = looked(a_map(100), Frame(scored(), strengths), learned=[400.0])[1]
    assert before[60] < 0 <= ratios[60] and ratios[30] > before[30] + 1
    weaker = looked(a_map(100), Frame(scored(), {30: 420.0, 60: 200.0}), learned=[400.0])[1]
    assert weaker[60] < -1


def test_an_image_that_shows_the_same_again_speaks_for_no_place_again(a_map):
    new, again = Frame(scored(), {30: 100.0}), Frame(scored(), {30: 100.0})
    again.novelty = 0.0
    first, second = (looked(a_map(100), frame)[1] for frame in (new, again))
    assert first[30] > 1 and second[30] == 0
    assert second[60] == first[60] < 0


@settings(max_examples=100)
@given(
    st.integers(1, 60),
    st.integers(0, 10**6),
    st.sampled_from([0.0, 1e-3, 1.0]),
    st.sampled_from([0.0, 1.0, 1e4]),
    st.one_of(st.none(), st.floats(0, 1e4)),
    st.integers(0, 60),
)
def test_whatever_is_shown_ratios_are_finite_and_in_bounds(
    a_map, count, seed, spread, most, step, start
):
    rng = np.random.default_rng(seed)
    scores = rng.normal(0, spread, count)
    scores[rng.random(count) < 0.2] = np.nan
    strengths = dict(enumerate(rng.uniform(0, most, count).tolist()))
    predicted = rng.permutation(count)[:6].tolist()
    listed = np.sort(rng.permutation(count)[:40])
    frame, believed = Frame(scores, strengths, step), np.flatnonzero(rng.random(count) < 0.5)
    believed = np.union1d(believed, predicted)
    seen, _ = looked(a_map(count), frame, predicted, start, listed, [50.0, 1e4], believed)
    assert {*believed.tolist()} <= {*seen.places.tolist()}
    assert (np.diff(seen.places) > 0).all() and np.isfinite(seen.log_ratios).all()
    assert (seen.log_ratios >= 2 * RATIO.least).all() and (seen.log_ratios <= RATIO.most).all()
    assert seen.has_rivals or (seen.log_ratios <= 0).all()


@pytest.mark.parametrize('true', [0.1, 3.0])
def test_a_scale_is_that_of_what_the_best_were_drawn_from(true):
    rng = np.random.default_rng(0)
    found = [gumbel_scale(np.sort(rng.gumbel(5.0, true, 200))[-5:]) for _ in range(3000)]
    assert np.mean(found) == pytest.approx(true, rel=0.1)
