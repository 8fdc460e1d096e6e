# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Records become messages and come back unchanged."""

from dataclasses import replace

from convseq_ros.core.map.place import Place
from convseq_ros.core.types import Candidate, Match, Pose, Reason
from convseq_ros.node.conversions import CANDIDATE, candidates_message, stamp_from_ns, stamp_to_ns
from hypothesis import given, strategies
import numpy as np
import pytest

STAMP_NS = 1_700_000_000_123_456_789
CANDIDATES = (Candidate(7, STAMP_NS - 60_000_000_000, 0.875), Candidate(2, 5, 0.5))
MATCH = Match(11, STAMP_NS, Reason.ACCEPTED, CANDIDATES, sequence_length=4)
POSE = Pose((1.0, -2.0, 0.5), (0.0, 0.0, 0.6, 0.8))


@given(strategies.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1))
def test_a_stamp_comes_back(stamp_ns):
    assert stamp_to_ns(stamp_from_ns(stamp_ns)) == stamp_ns


@pytest.mark.parametrize(
    ('stamp_ns', 'nearest_ns'),
    [
        (2**31 * 10**9, 2**31 * 10**9 - 1),
        (2**63 - 1, 2**31 * 10**9 - 1),
        (-(2**63), -(2**31) * 10**9),
    ],
)
def test_a_stamp_that_ros_cannot_say_is_the_nearest_one(stamp_ns, nearest_ns):
    assert stamp_to_ns(stamp_from_ns(stamp_ns)) == nearest_ns
    candidate = replace(CANDIDATES[0], reference_stamp_ns=stamp_ns)
    message = candidates_message(replace(MATCH, candidates=(candidate,)), {7: Place(0)}, 'm')
    assert len(np.frombuffer(bytes(message.data), CANDIDATE)) == 1
