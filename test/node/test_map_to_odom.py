# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The transform from the map to odometry, as nodes broadcast it."""

import sys
import types
from unittest.mock import Mock

from convseq_ros.node.outputs.map_to_odom import MapToOdom
from geometry_msgs.msg import TransformStamped
import numpy as np
import pytest
from std_msgs.msg import Header

SECOND = 1_000_000_000


@pytest.fixture
def transforms(monkeypatch):
    """Return a node's mock and its MapToOdom, with a stand-in for tf2_msgs."""
    kind = type('TFMessage', (), {'__init__': lambda self, transforms: setattr(
        self, 'transforms', transforms)})  # fmt: skip
    module = types.ModuleType('tf2_msgs.msg')
    module.TFMessage = kind
    monkeypatch.setitem(sys.modules, 'tf2_msgs', types.ModuleType('tf2_msgs'))
    monkeypatch.setitem(sys.modules, 'tf2_msgs.msg', module)
    node, topics = Mock(), {}
    node.create_publisher = lambda _kind, name, _qos, **_more: topics.setdefault(name, Mock())
    return node, topics, MapToOdom(node, 'map', True)


def test_the_transform_is_broadcast_at_most_20_times_a_second(transforms):
    _, topics, made = transforms
    for ms in range(0, 200, 10):
        made.publish(SECOND + ms * 10**6, 'odom', np.eye(4))
    assert topics['/tf'].publish.call_count == topics['~/map_to_odom'].publish.call_count == 4
    (one,) = topics['/tf'].publish.call_args.args[0].transforms
    assert (one.header.frame_id, one.child_frame_id) == ('map', 'odom')


def test_a_second_publisher_of_the_transform_ends_the_broadcast_with_one_error(transforms):
    node, topics, made = transforms
    made.publish(SECOND, 'odom', np.eye(4))
    own = topics['/tf'].publish.call_args.args[0]
    made._on_tf(own)  # comes back
    assert not made.problem
    base = TransformStamped(header=Header(frame_id='odom'), child_frame_id='base_link')
    made._on_tf(types.SimpleNamespace(transforms=[base]))
    assert not made.problem
    theirs = TransformStamped(header=Header(frame_id='world'), child_frame_id='odom')
    for _ in range(3):
        made._on_tf(types.SimpleNamespace(transforms=[theirs]))
    made.publish(2 * SECOND, 'odom', np.eye(4))
    assert topics['/tf'].publish.call_count == 1
    assert topics['~/map_to_odom'].publish.call_count == 2
    (line,) = [call.args[0] for call in node.get_logger().error.call_args_list]
    assert line == made.problem and 'world -> odom is on /tf already' in line


def test_odometry_in_the_frame_of_the_map_has_no_transform(transforms):
    _, topics, made = transforms
    made.publish(SECOND, 'map', np.eye(4))
    assert "odometry is in frame 'map'" in made.problem
    assert not topics['~/map_to_odom'].publish.called
