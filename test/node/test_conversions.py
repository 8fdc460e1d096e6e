# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Records become messages and come back unchanged."""

from dataclasses import replace

from convseq_ros.core.map.format import MapSession
from convseq_ros.core.map.place import Place
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Candidate, Match, Reason, RelativePose
from convseq_ros.node.conversions import CANDIDATE, candidates_message, stamp_from_ns, stamp_to_ns
from convseq_ros.node.outputs.closure_messages import closure_odometry_message
from hypothesis import given, strategies
import numpy as np
import pytest

STAMP_NS = 1_700_000_000_123_456_789
CANDIDATES = (Candidate(7, STAMP_NS - 60_000_000_000, 0.875), Candidate(2, 5, 0.5))
MATCH = Match(11, STAMP_NS, Reason.ACCEPTED, CANDIDATES, sequence_length=4)


@given(strategies.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1))
def test_a_stamp_is_the_same_after_conversion_to_ros_and_back(stamp_ns):
    assert stamp_to_ns(stamp_from_ns(stamp_ns)) == stamp_ns


@pytest.mark.parametrize(
    ('stamp_ns', 'nearest_ns'),
    [
        (2**31 * 10**9, 2**31 * 10**9 - 1),
        (2**63 - 1, 2**31 * 10**9 - 1),
        (-(2**63), -(2**31) * 10**9),
    ],
)
def test_a_stamp_out_of_ros_range_becomes_the_nearest_valid_one(stamp_ns, nearest_ns):
    assert stamp_to_ns(stamp_from_ns(stamp_ns)) == nearest_ns
    candidate = replace(CANDIDATES[0], reference_stamp_ns=stamp_ns)
    message = candidates_message(replace(MATCH, candidates=(candidate,)), {7: Place(0)}, 'm')
    assert len(np.frombuffer(bytes(message.data), CANDIDATE)) == 1


MEASURED = np.diag([0.1, 0.2, 0.3, 0.01, 0.02, 0.03])


def relative(position_m):
    """Return a turn to the left, with a position or without a scale."""
    return RelativePose((0.0, 0.0, 0.6, 0.8), position_m, (1.0, 0.0, 0.0), MEASURED, 40)


@pytest.mark.parametrize(
    ('measured', 'position', 'turn', 'variances'),
    [
        (relative((1.5, -0.5, 0.0)), (1.5, -0.5, 0.0), (0.6, 0.8), MEASURED.diagonal()),
        (relative(None), (0.0, 0.0, 0.0), (0.6, 0.8), [1e6, 1e6, 1e6, 0.01, 0.02, 0.03]),
        (None, (0.0, 0.0, 0.0), (0.0, 1.0), [1e6, 1e6, 1e6, 10.0, 10.0, 10.0]),
    ],
)
def test_unmeasured_parts_of_a_closure_pose_have_a_large_covariance(
    measured, position, turn, variances
):
    two = places_of_two_drives()
    match = replace(MATCH, candidates=(Candidate(1, 200, 0.9),), relative_pose=measured)
    message = closure_odometry_message(match, two, session_start=4)
    assert stamp_to_ns(message.header.stamp) == STAMP_NS
    # Of a map that does not grow, the query has no session.
    assert (message.header.frame_id, message.child_frame_id) == ('first/200', f'/{STAMP_NS}')
    pose = message.pose.pose
    assert (pose.position.x, pose.position.y, pose.position.z) == position
    assert (pose.orientation.z, pose.orientation.w) == turn
    assert np.array_equal(message.pose.covariance.reshape(6, 6), np.diag(variances))


def test_a_closure_of_a_growing_map_names_the_session_of_its_query():
    match = replace(MATCH, candidates=(Candidate(2, 300, 0.9, session=1),))
    message = closure_odometry_message(match, places_of_two_drives(), session_start=2)
    ids = message.header.frame_id, message.child_frame_id
    assert ids == ('second/300', f'second/{STAMP_NS}')
    with pytest.raises(ValueError, match='accepted'):
        closure_odometry_message(replace(match, reason=Reason.WEAK), ReferenceMap(), 0)


def places_of_two_drives():
    """Return a map with two places in each of two sessions."""
    places = ReferenceMap()
    for number, name in enumerate(('first', 'second')):
        places.sessions.append(MapSession(name, '', 0))
        for stamp_ns in (200 * number + 100, 200 * number + 200):
            places.add(Place(stamp_ns, session=number), np.ones(places.cell_shape, np.float16))
    return places
