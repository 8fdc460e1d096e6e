# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Bridges to back ends that cannot run here: their messages, serialised and read back as CDR.

The node of examples/bridges needs the back ends' packages: it is *not run here*, but compiled; the
part for Swarm-SLAM is given messages by hand.
"""

import math
from types import SimpleNamespace
from uuid import UUID
import zlib

import pytest

pytest.importorskip('rosbags', reason='needs rosbags: pip install rosbags')

from interfaces import blank, type_store
from keyframes import Closure, Keyframes, robots_of, Waiting
import messages
import numpy as np

QUERY_NS, REFERENCE_NS = 1_795_355_676_679_518_551, 1_700_000_000_999_999_999
HALF = math.sin(0.25), math.cos(0.25)
THEIRS, OURS = UUID(int=5), UUID(int=6)
CLOSURE = Closure(
    QUERY_NS,
    REFERENCE_NS,
    np.array([2.0, -0.5, 0.25]),
    np.array([0.0, 0.0, *HALF]),
    np.diag([0.04, 0.09, 0.16, 1e-4, 4e-4, 9e-4]),
    0.9,
)
# Quick and exact: a body that is turned by half a radian to the left of the reference.
TURN = np.array([[math.cos(0.5), -math.sin(0.5), 0], [math.sin(0.5), math.cos(0.5), 0], [0, 0, 1]])


@pytest.fixture(scope='module')
def store():
    return type_store()


def round_trip(store, message):
    name = message.__msgtype__
    return store.deserialize_cdr(bytes(store.serialize_cdr(message, name)), name)


def header(store):
    return blank(store, 'std_msgs/msg/Header', frame_id='map')


def test_rtabmap_finds_its_nodes_by_stamp_in_map_data(store):
    nodes = [
        blank(store, 'rtabmap_msgs/msg/Node', id=ident, stamp=stamp_ns / 1e9)
        for ident, stamp_ns in ((7, REFERENCE_NS - 40_000_000), (8, REFERENCE_NS + 400_000_000))
    ]
    data = round_trip(store, blank(store, 'rtabmap_msgs/msg/MapData', nodes=nodes))
    keyframes = Keyframes()
    for _ in range(2):  # rtabmap sends the same nodes again and again
        for node in data.nodes:
            keyframes.add(round(node.stamp * 1e9), node.id)
    assert keyframes.find(REFERENCE_NS) == 7
    assert keyframes.find(REFERENCE_NS + 390_000_000) == 8
    assert keyframes.find(QUERY_NS) is None


def test_rtabmap_link_goes_from_the_newer_to_the_older_node(store):
    link = round_trip(store, messages.rtabmap_link(store.types, 40, 7, CLOSURE))
    assert (link.from_id, link.to_id, link.type) == (40, 7, 4)
    at, turn = link.transform.translation, link.transform.rotation
    # The reference as the query sees it.
    assert (at.x, at.y, at.z) == pytest.approx(tuple(-TURN.T @ CLOSURE.position))
    assert (turn.z, turn.w) == pytest.approx((-HALF[0], HALF[1]))
    information = np.reshape(link.information, (6, 6))
    assert np.allclose(information, information.T)
    # Seen from the query, the error of its own turn moves the reference about.
    moved = np.array([error_of_inverse(1e-6 * error) for error in np.eye(6)]).T / 1e-6
    assert np.allclose(np.linalg.inv(information), moved @ CLOSURE.covariance @ moved.T, atol=1e-5)


def error_of_inverse(error):
    """Return how far off the inverse is, if the closure is off by so much."""
    turned = rotation(error[3:]) @ TURN
    position = -turned.T @ (CLOSURE.position + error[:3])
    change = turned.T @ TURN
    angles = (change - change.T)[(2, 0, 1), (1, 2, 0)] / 2
    return [*(position + TURN.T @ CLOSURE.position), *angles]


def rotation(vector):
    x, y, z = vector
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + cross + cross @ cross / 2


def test_our_descriptor_is_what_rtabmap_uncompresses(store):
    vector = np.linspace(-1, 1, 288, dtype=np.float32)
    made = messages.rtabmap_descriptor(store.types, header(store), vector)
    data = round_trip(store, made).data.tobytes()
    rows, columns, kind = np.frombuffer(data[-12:], '<i4')
    assert (rows, columns, kind) == (1, 288, 5)
    assert (np.frombuffer(zlib.decompress(data[:-12]), '<f4') == vector).all()


@pytest.fixture
def bridge(store, monkeypatch):
    """Return a bridge to Swarm-SLAM for robot 2, what it sent, and who hears which topic."""
    node = pytest.importorskip('bridge_node', reason='needs rclpy')
    sent, heard = [], {}
    given = {'sessions': [f'{THEIRS}=1', f'{OURS}=2'], 'robot_id': 2}

    class Unconnected(node.Bridge):
        def declare_parameter(self, name, usual):
            return SimpleNamespace(value=given.get(name, usual))

        def create_publisher(self, _kind, topic, _depth):
            return SimpleNamespace(
                publish=lambda message: sent.append((topic, round_trip(store, message)))
            )

        def create_subscription(self, _kind, topic, on_message, _depth):
            heard[topic] = on_message

    monkeypatch.setattr(node, 'Kinds', lambda: store.types)
    monkeypatch.setattr(node.Node, '__init__', lambda *_: None)
    return Unconnected('swarm_slam'), sent, heard


def keyframe(store, ident, stamp_ns):
    sec, nanosec = divmod(stamp_ns, 10**9)
    stamp = blank(store, 'builtin_interfaces/msg/Time', sec=sec, nanosec=nanosec)
    odom = blank(
        store, 'nav_msgs/msg/Odometry', header=blank(store, 'std_msgs/msg/Header', stamp=stamp)
    )
    return blank(store, 'cslam_common_interfaces/msg/KeyframeOdom', id=ident, odom=odom)


def closure_to(session, confidence=0.75):
    """Return `~/closure` as the node sends it, without a pose, to a place of a session."""
    from convseq_ros.node.conversions import cloud_message
    from convseq_ros.node.outputs.closure_messages import CLOSURE as ROW
    from std_msgs.msg import Header

    row = np.zeros(1, ROW)
    row['x'] = row['y'] = row['z'] = np.nan
    row['layout'], row['confidence'] = 1, confidence
    row['query_sec'], row['query_nanosec'] = divmod(QUERY_NS, 10**9)
    row['reference_sec'], row['reference_nanosec'] = divmod(REFERENCE_NS, 10**9)
    row['reference_session'] = np.frombuffer(session.bytes, np.uint8)
    return cloud_message(row, Header(), is_dense=False)


def test_swarm_slam_gets_the_robot_that_drove_the_session(bridge, store):
    _, sent, heard = bridge
    assert sorted(heard) == ['/r1/cslam/keyframe_odom', 'closure', 'cslam/keyframe_odom']
    heard['closure'](closure_to(THEIRS))
    heard['cslam/keyframe_odom'](keyframe(store, 40, QUERY_NS))
    # Of this robot, not of the one that drove there.
    heard['cslam/keyframe_odom'](keyframe(store, 7, REFERENCE_NS))
    assert not sent
    heard['/r1/cslam/keyframe_odom'](keyframe(store, 40, REFERENCE_NS + 20_000_000))
    ((topic, told),) = sent
    assert topic == '/cslam/inter_robot_matches'
    (match,) = told.matches
    assert (match.robot0_id, match.robot0_keyframe_id) == (2, 40)
    assert (match.robot1_id, match.robot1_keyframe_id, match.weight) == (1, 40, 0.75)
    # Each robot leaves out what it sent itself: it would, if that were 1 or 2.
    assert told.robot_id == 2**32 - 1
    assert len(sent) == 1


@pytest.mark.parametrize('session', [OURS, UUID(int=9)])
def test_swarm_slam_gets_matches_of_one_robot_as_local_ones(bridge, store, session):
    _, sent, heard = bridge
    heard['closure'](closure_to(session))
    for ident, stamp_ns in ((40, QUERY_NS), (7, REFERENCE_NS)):
        heard['cslam/keyframe_odom'](keyframe(store, ident, stamp_ns))
    ((topic, match),) = sent
    assert topic == 'cslam/local_keyframe_match'
    assert (match.keyframe0_id, match.keyframe1_id) == (40, 7)


def test_a_closure_without_confidence_counts_as_sure(bridge, store):
    _, sent, heard = bridge
    heard['closure'](closure_to(THEIRS, np.nan))
    heard['cslam/keyframe_odom'](keyframe(store, 40, QUERY_NS))
    heard['/r1/cslam/keyframe_odom'](keyframe(store, 7, REFERENCE_NS))
    assert sent[0][1].matches[0].weight == 1.0


@pytest.mark.parametrize('text', ['1', f'{OURS}', f'{OURS}=-1', f'{OURS}=x', 'home=1', '=1'])
def test_a_session_without_a_valid_robot_number_is_refused(text):
    with pytest.raises(ValueError, match='sessions: '):
        robots_of([text])


def test_closures_wait_for_a_back_end_that_comes_late_or_goes_away():
    waiting, sent = Waiting(Keyframes()), []

    def send(*closure):
        if not is_there:
            return False
        sent.append(closure)
        return True

    is_there = True
    waiting.add(QUERY_NS, REFERENCE_NS, 'first')
    waiting.send(send)
    assert not sent and len(waiting) == 1
    waiting.keyframes.add(REFERENCE_NS, 7)
    waiting.send(send)
    assert not sent
    waiting.keyframes.add(QUERY_NS + 10_000_000, 40)
    is_there = False
    waiting.send(send)
    assert not sent and len(waiting) == 1
    is_there = True
    waiting.send(send)
    waiting.send(send)
    assert sent == [(40, 7, 'first')] and not len(waiting)
    # Within one keyframe there is nothing to close.
    waiting.add(QUERY_NS, QUERY_NS + 1, 'second')
    waiting.send(send)
    assert len(sent) == 1 and not len(waiting)
    for number in range(2000):
        waiting.add(number * 10**9, number, 'never')
    assert len(waiting) == 1000
