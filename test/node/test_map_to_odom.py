# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The transform from the map to odometry: broadcast by nodes, and measured by relative poses."""

import math
import sys
from types import SimpleNamespace
from unittest.mock import Mock

from convseq_ros.config.node_config import NodeConfig
from convseq_ros.core.rigid import inverse, matrix, pose_of
from convseq_ros.core.types import Frame, PoseEstimate, RelativePose
from convseq_ros.node.conversions import stamp_to_ns
from convseq_ros.node.outputs.map_to_odom import MapToOdom
from convseq_ros.node.outputs.measured_transform import MeasuredTransform
from geometry_msgs.msg import TransformStamped
import numpy as np
from poses import at
import pytest
from std_msgs.msg import Header

SECOND = 1_000_000_000


@pytest.fixture
def transforms(monkeypatch):
    """Return a node's mock and its MapToOdom, with a stand-in for tf2_msgs."""
    module = SimpleNamespace(TFMessage=lambda transforms: SimpleNamespace(transforms=transforms))
    monkeypatch.setitem(sys.modules, 'tf2_msgs', SimpleNamespace(msg=module))
    monkeypatch.setitem(sys.modules, 'tf2_msgs.msg', module)
    node, topics = Mock(), {}
    node.create_publisher = lambda _kind, name, _qos, **_more: topics.setdefault(name, Mock())
    return node, topics, MapToOdom(node, 'map', True)


def test_the_transform_is_broadcast_at_most_20_times_a_second_dated_ahead_on_tf(transforms):
    _, topics, made = transforms
    for ms in range(0, 200, 10):
        made.publish(SECOND + ms * 10**6, 'odom', np.eye(4))
    assert topics['/tf'].publish.call_count == topics['~/map_to_odom'].publish.call_count == 4
    own, *_ = (call.args[0] for call in topics['/tf'].publish.call_args_list)
    (one,) = own.transforms
    assert (one.header.frame_id, one.child_frame_id) == ('map', 'odom')
    assert stamp_to_ns(one.header.stamp) == SECOND + SECOND // 10
    told = topics['~/map_to_odom'].publish.call_args_list[0].args[0]
    assert stamp_to_ns(told.header.stamp) == SECOND
    made._on_tf(own)  # comes back, and is known as our own
    assert not made.problem


def test_frames_with_the_slash_of_ros_1_are_compared_and_sent_without(transforms):
    _, topics, made = transforms
    made.publish(SECOND, '/odom', np.eye(4))
    (one,) = topics['/tf'].publish.call_args.args[0].transforms
    assert one.child_frame_id == 'odom'
    made._on_tf(on_tf('map', '/odom'))
    assert 'is on /tf already' in made.problem
    made.publish(2 * SECOND, '/map', np.eye(4))
    assert topics['~/map_to_odom'].publish.call_count == 1


def on_tf(parent, child):
    stamped = TransformStamped(header=Header(frame_id=parent), child_frame_id=child)
    return SimpleNamespace(transforms=[stamped])


def test_a_second_publisher_of_the_transform_ends_the_broadcast_with_one_error(transforms):
    node, topics, made = transforms
    made.publish(SECOND, 'odom', np.eye(4))
    made._on_tf(on_tf('odom', 'base_link'))
    assert not made.problem
    for _ in range(3):
        made._on_tf(on_tf('world', 'odom'))
    made.publish(2 * SECOND, 'odom', np.eye(4))
    assert topics['/tf'].publish.call_count == 1
    assert topics['~/map_to_odom'].publish.call_count == 2
    (line,) = {call.args[0] for call in node.get_logger().error.call_args_list}
    assert line == made.problem and 'world -> odom is on /tf already' in line


def test_odometry_in_the_frame_of_the_map_has_no_transform(transforms):
    _, topics, made = transforms
    made.publish(SECOND, 'map', np.eye(4))
    assert "odometry is in frame 'map'" in made.problem
    assert not topics['~/map_to_odom'].publish.called
    made.publish(2 * SECOND, 'odom', np.eye(4))
    assert not made.problem and topics['/tf'].publish.called


NOISE = np.diag([0.01] * 3 + [1e-4] * 3)
OFF = matrix(at(100.0, -20.0, 1.0))  # the frame of odometry in the map


@pytest.fixture
def made(monkeypatch):
    """Return the filter; what it publishes is in `sent`."""
    transform = MeasuredTransform(Mock(), NodeConfig())
    sent = []
    monkeypatch.setattr(transform._output, 'publish', lambda *all_: sent.append(all_))
    return SimpleNamespace(transform=transform, sent=sent)


def measure(made, seconds, true, drifted=None, has_position=True):
    """Measure where the base is in the map; `drifted` is what odometry says."""
    goal = pose_of(OFF @ matrix(true))
    frame = Frame(seconds * SECOND, None, pose=drifted or true)
    position = (0.0, 0.0, 0.0) if has_position else None
    relative = RelativePose((0.0, 0.0, 0.0, 1.0), position, None, NOISE, 50)
    made.transform.update(frame, Mock(relative_pose=relative), PoseEstimate(goal, NOISE), 0.5)


def test_a_measured_transform_moves_with_odometry(made):
    made.transform.on_odometry(SECOND, 'odom')
    assert not made.sent and made.transform.values == {}
    measure(made, 1, at(3.0, 1.0, 0.2), has_position=False)
    made.transform.on_odometry(2 * SECOND, 'odom')
    assert not made.sent  # without a position nothing is known
    measure(made, 2, at(3.0, 1.0, 0.2))
    made.transform.on_odometry(4 * SECOND, 'odom')
    ((stamp_ns, frame_id, moved),) = made.sent
    assert (stamp_ns, frame_id) == (4 * SECOND, 'odom') and np.allclose(moved, OFF)
    made.transform._output.stamp_ns = stamp_ns
    values = made.transform.values
    assert values['map_to_odom_age_s'] == 2.0
    made.transform.update(Frame(9 * SECOND, None), Mock(relative_pose=None), None, 0.5)
    assert made.transform.values['map_to_odom_age_s'] == 7.0  # odometry stopped, images did not


def test_the_sigma_of_map_to_odom_is_of_now(made):
    def sigmas():
        values = made.transform.values
        return values['map_to_odom_sigma_m'], values['map_to_odom_sigma_rad']

    measure(made, 1, at(0.0))
    radians = NodeConfig().heading_sigma_rad
    assert sigmas() == pytest.approx((math.hypot(0.1, 0.5), math.hypot(0.01, radians)))
    for seconds, x in ((2, 10.0), (3, 20.0)):  # nothing is recognised: odometry drifts
        frame = Frame(seconds * SECOND, None, pose=at(x))
        made.transform.update(frame, Mock(relative_pose=None), None, 4.0)
    assert sigmas()[0] == pytest.approx(math.hypot(0.1, 4.0, 20 * 0.05))
    measure(made, 4, at(60.0), at(20.0))  # carried, or a false place
    assert sigmas()[0] > 40
    made.transform.update(Frame(SECOND // 2, None), Mock(relative_pose=None), None, 0.5)
    assert sigmas() == (math.inf, math.inf)


def test_noise_is_averaged_and_drift_is_followed(made):
    rng = np.random.default_rng(0)
    errors = []
    for step in range(1, 60):
        true = at(step, 0.0, 0.0)
        drifted = at(1.01 * step, 0.02 * step, 0.0)
        noisy = at(step + rng.normal(0, 0.1), rng.normal(0, 0.1), rng.normal(0, 0.01))
        measure(made, step, noisy, drifted)
        made.transform.on_odometry(step * SECOND, 'odom')
        base = made.sent[-1][2] @ matrix(drifted)
        errors.append(np.linalg.norm((inverse(OFF @ matrix(true)) @ base)[:3, 3]))
    assert np.median(errors[10:]) < 0.1


def test_one_wrong_pose_is_passed_over_and_a_moved_robot_is_followed(made):
    for step in (1, 2, 3):
        measure(made, step, at(step))
    measure(made, 4, at(30.0, 5.0), at(4.0))
    made.transform.on_odometry(4 * SECOND, 'odom')
    assert np.allclose(made.sent[-1][2], OFF, atol=1e-6)
    for step in (5, 6, 7):  # it was carried: odometry did not notice
        measure(made, step, at(step + 30.0), at(step))
    made.transform.on_odometry(7 * SECOND, 'odom')
    base = made.sent[-1][2] @ matrix(at(7.0))
    assert np.allclose(base, OFF @ matrix(at(37.0)), atol=1e-6)


def test_a_backward_clock_jump_restarts_the_measured_transform(made):
    measure(made, 100, at(1.0))
    measure(made, 5, at(2.0, 9.0, math.pi), at(0.0))
    made.transform.on_odometry(5 * SECOND, 'odom')
    base = made.sent[-1][2] @ matrix(at(0.0))
    assert np.allclose(base, OFF @ matrix(at(2.0, 9.0, math.pi)), atol=1e-6)
