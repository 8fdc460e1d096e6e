# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which places are near another one."""

from convseq_ros.core.graph.neighbourhood import Neighbourhood
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np


def test_places_beside_a_place_and_beside_its_looks_are_near(a_map):
    whole = a_map(40, 40)
    whole.links.add(60, 20)
    near = Neighbourhood(whole)
    assert near.is_near(63, 60, 3) and not near.is_near(64, 60, 3)
    # Looks of 60 are 12 to 28: anchors within eight of its own.
    for place, is_near in ((9, True), (8, False), (31, True), (32, False), (39, False)):
        assert near.is_near(place, 60, 3) is is_near
    assert near.is_near(57, 28, 3) and not near.is_near(56, 28, 3)
    assert not near.is_near(60, 5, 3)


def test_places_of_another_session_are_never_near(a_map):
    near = Neighbourhood(a_map(10, 10))
    assert near.is_near(9, 8, 4) and not near.is_near(10, 9, 4)
    assert near.mask(np.arange(20), 10, 4).nonzero()[0].tolist() == [*range(10, 15)]


@settings(max_examples=60)
@given(
    st.lists(st.integers(1, 30), min_size=1, max_size=4),
    st.integers(0, 99),
    st.integers(0, 12),
    st.integers(0, 119),
)
def test_the_mask_of_near_places_agrees_with_the_test_of_each_place(
    a_map, lengths, seed, distance, index
):
    whole, rng = a_map(*lengths), np.random.default_rng(seed)
    for place in range(1, len(whole)):
        if rng.random() < 0.4:
            whole.links.add(place, int(rng.integers(place)))
    near, index = Neighbourhood(whole), index % len(whole)
    places = np.flatnonzero(rng.random(len(whole)) < 0.7)
    said = [near.is_near(one, index, distance) for one in places.tolist()]
    assert near.mask(places, index, distance).tolist() == said
    assert near.is_near(index, index, distance)
