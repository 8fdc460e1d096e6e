# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sums of coarse scores along the way: the recursion, by brute force and by hand."""

from convseq_ros.core.sequence.coarse_scores import TRACK, Track
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest


def session_of(place, starts):
    return int(np.searchsorted(starts, place, 'right'))


def brute_force(rows, starts, both):
    """Return, place by place, its score and most of the best of the places that led there."""
    sums = rows[0].astype(float)
    for row in rows[1:]:
        before = np.append(sums, np.full(len(row) - len(sums), sums.min()))
        sums = np.empty(len(row))
        for place in range(len(row)):
            last = place + TRACK.reach if both else place
            led = [
                before[one]
                for one in range(max(0, place - TRACK.reach), min(last, len(row) - 1) + 1)
                if session_of(one, starts) == session_of(place, starts)
            ]
            sums[place] = row[place] + TRACK.memory * max(led)
    return sums


@settings(max_examples=150)
@given(
    st.integers(1, 40),
    st.lists(st.integers(0, 5), max_size=6),
    st.sets(st.integers(1, 70), max_size=6),
    st.booleans(),
    st.integers(0, 999),
)
def test_sums_are_those_of_the_recursion(count, grown, starts, both, seed):
    rng, track = np.random.default_rng(seed), Track(both)
    lengths = np.cumsum([count, *grown])
    rows = [rng.normal(0, 1, length).astype(np.float32) for length in lengths]
    own = np.array([0, *sorted(starts)])
    for row in rows:
        track.update(row, own[own < len(row)])
    assert track.sums.dtype == np.float32
    assert track.sums == pytest.approx(brute_force(rows, own, both), abs=1e-4)


def test_after_a_reset_nothing_is_left():
    track = Track(False)
    track.update(np.ones(5, np.float32), np.zeros(1, np.int64))
    track.reset()
    track.update(np.zeros(5, np.float32), np.zeros(1, np.int64))
    assert track.sums.tolist() == [0] * 5


def test_the_row_that_came_is_not_changed():
    row, track = np.ones(5, np.float32), Track(True)
    for _ in range(3):
        track.update(row, np.zeros(1, np.int64))
    assert row.tolist() == [1] * 5
