# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The motion of places, by velocities and by odometry."""

import tracemalloc

from convseq_ros.core.decision.motion import MOTION, MotionModel
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
from poses import at
import pytest

ERROR = 0.1


def moved(reference_map, *xs, places=(10,), both=False, missing=0, yaw=0.0):
    """Return velocities, and what becomes of places after odometry was at some x."""
    model = MotionModel(reference_map, both, ERROR)
    for x in xs:
        model.move(None if x is None else at(x, yaw=yaw), missing)
    return model.velocities, *model.moved(np.array(places))


@pytest.mark.parametrize('missing', [0, 3])
def test_without_odometry_places_move_by_each_velocity_for_every_keyframe(a_map, missing):
    velocities, found, sigmas = moved(a_map(30), None, missing=missing, places=(4, 9))
    ahead = set(MOTION.velocities)
    assert set(velocities.tolist()) == ahead | {-one for one in ahead}
    expected = np.array([[4], [9]]) + (1 + missing) * velocities
    assert found == pytest.approx(expected.T)
    distance = (1 + missing) * abs(velocities[:, None])
    sigma = MOTION.sigma_places + ERROR * distance
    assert sigmas == pytest.approx(np.broadcast_to(sigma, found.shape))


def test_backward_velocities_have_1_percent_and_half_with_both_directions(a_map):
    for both, share in ((False, 0.01), (True, 0.5)):
        model = MotionModel(a_map(3), both, ERROR)
        assert model.prior.sum() == pytest.approx(1)
        assert model.prior[model.velocities < 0].sum() == pytest.approx(share)


def test_odometry_moves_places_along_the_maps_poses_at_any_velocity(a_map):
    velocities, found, sigmas = moved(a_map(30, step_m=2.0), 0, 5, both=True, places=(10, 20))
    expected = np.where(velocities < 0, [[7.5], [17.5]], [[12.5], [22.5]]).T
    assert found == pytest.approx(expected)
    assert sigmas == pytest.approx(np.full(found.shape, MOTION.sigma_places + ERROR * 2.5))


def test_distances_between_places_take_no_more_memory_in_a_larger_map(a_map):
    street = a_map(8000, step_m=2.0)
    model = MotionModel(street, False, ERROR)
    for x in (0, 1):
        model.move(at(x), 0)
    tracemalloc.start()
    for place in range(8000):
        model.moved(np.array([place]))
    taken, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert taken < 500_000


def test_beyond_the_end_of_a_session_places_are_as_far_apart_as_the_last(a_map):
    velocities, found, _ = moved(a_map(30, step_m=2.0), 0, 5, places=(1, 28))
    assert found[velocities < 0, 0] == pytest.approx(-1.5)
    assert found[velocities > 0, 1] == pytest.approx(30.5)


def test_backward_odometry_moves_places_backward_and_ahead_on_reversed_drives(a_map):
    street = a_map(30, step_m=2.0)
    for xs, yaw in (((5, 0), 0.0), ((0, 5), np.pi)):  # in reverse gear, as the robot is turned
        velocities, found, _ = moved(street, *xs, both=True, yaw=yaw)
        assert found[:, 0] == pytest.approx(np.where(velocities < 0, 12.5, 7.5))


@settings(max_examples=60)
@given(
    st.lists(st.one_of(st.none(), st.floats(-1e9, 1e9)), min_size=1, max_size=6),
    st.sampled_from([None, 0.0, 1e-6, 1.0, 1e6]),
    st.booleans(),
    st.integers(0, 5),
)
def test_the_motion_is_finite_for_any_odometry(a_map, xs, step_m, both, missing):
    street = a_map(1, 5, 12, step_m=step_m)
    _, found, sigmas = moved(street, *xs, places=range(18), both=both, missing=missing)
    assert np.isfinite(found).all() and np.isfinite(sigmas).all()
    assert (sigmas >= MOTION.sigma_places).all()
