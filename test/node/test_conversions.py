# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Records become messages and come back unchanged."""

from dataclasses import replace

from convseq_ros.core.map.place import Place
from convseq_ros.core.types import Candidate, Match, Pose, Reason, Status
from convseq_ros.node.conversions import (
    CANDIDATE,
    candidates_message,
    image_message,
    loop_closure_message,
    match_header,
    stamp_from_ns,
    stamp_to_ns,
)
from convseq_ros.sources.images import decode_image
from hypothesis import given, strategies
import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2

STAMP_NS = 1_700_000_000_123_456_789
CANDIDATES = (Candidate(7, STAMP_NS - 60_000_000_000, 0.875), Candidate(2, 5, 0.5))
MATCH = Match(11, STAMP_NS, Status.ACCEPTED, Reason.ACCEPTED, CANDIDATES, sequence_length=4)
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


def test_candidates_come_back_through_the_wire():
    message = candidates_message(MATCH, {7: Place(0, pose=POSE), 2: Place(0)}, 'map')
    message = deserialize_message(serialize_message(message), PointCloud2)
    rows = np.frombuffer(bytes(message.data), CANDIDATE)
    assert rows['index'].tolist() == [7, 2]
    assert rows['score'].tolist() == [0.875, 0.5]
    assert rows['length'].tolist() == [4, 4]
    assert [rows[axis][0] for axis in 'xyz'] == [1.0, -2.0, 0.5]
    # A place without a pose is nowhere, not at the origin.
    assert all(np.isnan(rows[axis][1]) for axis in 'xyz') and not message.is_dense
    stamps = rows['stamp_sec'].astype(np.int64) * 10**9 + rows['stamp_nanosec']
    assert stamps.tolist() == [candidate.reference_stamp_ns for candidate in CANDIDATES]
    assert stamp_to_ns(message.header.stamp) == STAMP_NS
    assert message.header.frame_id == 'map'


def test_a_loop_closure_is_two_times_in_seconds():
    data = loop_closure_message(MATCH.query_stamp_ns, CANDIDATES[0]).data
    assert len(data) == 2
    assert data[0] == pytest.approx(1_700_000_000.123_456_789, abs=3e-7)
    assert data[0] - data[1] == pytest.approx(60.0, abs=5e-7)


@pytest.mark.parametrize('encoding', ['mono8', 'bgr8'])
def test_a_picture_comes_back(encoding):
    gray = np.random.default_rng(0).integers(0, 256, (7, 5), np.uint8)
    picture = gray if encoding == 'mono8' else np.repeat(gray[:, :, None], 3, axis=2)
    message = image_message(picture, match_header(MATCH, 'camera'))
    assert message.encoding == encoding
    assert np.array_equal(decode_image(message), gray)
