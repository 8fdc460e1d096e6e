# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Odometry, camera_info and TF complete the frames."""

from functools import partial
import sys
import threading
from types import SimpleNamespace
from unittest.mock import Mock

from convseq_ros.core.types import Camera, Pose
from convseq_ros.node.conversions import stamp_from_ns
from convseq_ros.node.inputs.camera_description import CameraDescription
from convseq_ros.node.inputs.camera_mount import Mount
from convseq_ros.node.inputs.following_subscription import FollowingSubscription
from convseq_ros.node.inputs.odometry_listener import OdometryListener
from convseq_ros.node.qos import LATCHED
from convseq_ros.sources.mount import OdometryFrame
from nav_msgs.msg import Odometry
import pytest
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, Image

SECOND = 1_000_000_000
MS = 1_000_000
K = [100.0, 0.0, 80.0, 0.0, 100.0, 60.0, 0.0, 0.0, 1.0]
QUICK = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)


def odometry(x, stamp_ns, frame_id='odom', child=''):
    message = Odometry(child_frame_id=child)
    message.header.stamp = stamp_from_ns(stamp_ns)
    message.header.frame_id = frame_id
    message.pose.pose.position.x = float(x)
    message.pose.pose.orientation.w = 1.0
    return message


def camera_info(k=K, width=160, height=120):
    return CameraInfo(k=k, width=width, height=height)


@pytest.fixture
def frames(vpr, map_path, monkeypatch):
    """Return a node, and the frames that its recogniser gets."""
    from convseq_ros.core.recognizer import PlaceRecognizer

    received = []
    process = PlaceRecognizer.process

    def record(recognizer, frame):
        received.append(frame)
        return process(recognizer, frame)

    monkeypatch.setattr(PlaceRecognizer, 'process', record)
    return vpr(map_path=map_path, fixed_length=1), received


@pytest.mark.parametrize('qos', [10, QUICK])
def test_a_frame_gets_the_pose_of_its_stamp_and_a_camera_of_its_size(
    client, frames, street, image, qos
):
    node, received = frames
    odom = client.camera(Odometry, '/odom', qos)
    info = client.camera(CameraInfo, '/camera_info', qos)
    surroundings = node._frame_context

    def heard():
        for x in (0, 1, 2):
            odom.publish(odometry(x, (10 + x) * SECOND))
        info.publish(camera_info([2 * value for value in K], 320, 240))
        return surroundings.odometry.heard and surroundings.camera.is_calibrated

    client.wait_for(heard)
    camera = client.camera(Image)
    camera.publish(image(street[0], 10 * SECOND + 250 * MS))
    camera.publish(image(street[1], 20 * SECOND))
    client.wait_for(lambda: len(received) == 2)
    assert received[0].pose.position == (0.25, 0.0, 0.0)
    assert received[0].camera == Camera(160, 120, 100.0, 100.0, 80.0, 60.0)
    assert received[1].pose is None
    client.wait_for(lambda: node._situation().further['frames_without_pose'] == 1)
    assert surroundings.odometry.frame_id == 'odom'


def test_bad_camera_info_is_one_warning_and_no_camera(client, frames, street, image, capfd):
    node, received = frames
    info = client.camera(CameraInfo, '/camera_info')
    info.publish(camera_info())
    client.wait_for(lambda: node._frame_context.camera.is_calibrated)
    for _ in range(3):
        info.publish(camera_info(width=0))
    client.wait_for(lambda: not node._frame_context.camera.is_calibrated)
    client.camera(Image).publish(image(street[0], SECOND))
    client.wait_for(lambda: received)
    assert received[0].camera is None
    assert ''.join(capfd.readouterr()).count('are not those of a camera') == 1


def test_latched_camera_info_sent_before_the_start_is_received(client, vpr, map_path):
    latched = client.node.create_publisher(CameraInfo, '/camera_info', LATCHED)
    latched.publish(camera_info())
    node = vpr(map_path=map_path)
    camera = node._frame_context.camera
    client.wait_for(lambda: camera.is_calibrated)
    # One that keeps nothing is heard beside it.
    client.camera(CameraInfo, '/camera_info').publish(camera_info(width=0))
    client.wait_for(lambda: not camera.is_calibrated)


def test_camera_info_of_other_proportions_is_left_out_with_one_line(monkeypatch):
    monkeypatch.setattr(FollowingSubscription, 'start', lambda _self: None)
    node = Mock()
    described = CameraDescription(node, Mock(of=lambda _frame: None))
    described._on_camera_info(camera_info(height=90))
    assert described.for_image(120, 160) is None and described.for_image(120, 160) is None
    (line,) = [call.args[0] for call in node.get_logger().warning.call_args_list]
    assert 'camera_info is of 160 x 90 px, and images of 160 x 120 px have other prop' in line
    assert described.for_image(180, 320).fx_px == 200


class Tracked:
    """An OdometryListener that hears what the test says, without a graph."""

    def __init__(self, monkeypatch, wait_s=0.05, publishers=1):
        monkeypatch.setattr(FollowingSubscription, 'start', lambda _self: None)
        node = Mock()
        node.count_publishers.return_value = publishers
        self.warning = node.get_logger.return_value.warning
        self.bases = {}  # poses of the base in other frames
        frame = OdometryFrame('base_link', self.bases.get)
        self.odometry = OdometryListener(node, wait_s, frame)
        self.pose_at, self._hear = self.odometry.pose_at, self.odometry._subscription.hear

    def hear(self, *told, **more):
        for x, stamp_ns in told:
            self._hear(odometry(x, stamp_ns, **more))

    def wait_for_pose(self, stamp_ns):
        """Ask for a pose in a thread; return it, and what it is going to find."""
        found = []
        waiting = threading.Thread(target=lambda: found.append(self.pose_at(stamp_ns)))
        waiting.start()
        return waiting, found


@pytest.fixture
def tracked(monkeypatch):
    """Return a maker of such a listener."""
    return partial(Tracked, monkeypatch)


def test_an_image_waits_for_its_odometry(tracked):
    one = tracked(wait_s=20.0)
    one.hear((0, SECOND))
    waiting, found = one.wait_for_pose(SECOND + 50 * MS)
    one.hear((1, SECOND + 100 * MS))
    waiting.join(10)
    assert found[0].position[0] == 0.5


def test_a_pose_is_extrapolated_from_the_last_two_after_a_short_wait(tracked):
    one = tracked(wait_s=0.001)
    one.hear((0, SECOND), (1, SECOND + 100 * MS))
    assert one.pose_at(SECOND + 150 * MS).position[0] == pytest.approx(1.5)
    assert one.pose_at(SECOND + 400 * MS) is None
    assert one.odometry.without_pose == 1


def test_no_image_waits_for_odometry_that_stopped_or_never_came(tracked):
    stopped = tracked(wait_s=3600.0)
    stopped.hear((0, SECOND))
    assert stopped.pose_at(3 * SECOND) is None
    silent = tracked(wait_s=3600.0, publishers=0)
    assert silent.pose_at(SECOND) is None
    assert silent.odometry.without_pose == 0
    announced = tracked(wait_s=0.0)
    for _ in range(3):
        announced.pose_at(SECOND)
    announced.odometry.wait_s = 3600.0
    assert announced.pose_at(SECOND) is None


def test_after_three_vain_waits_images_do_not_wait_until_odometry_returns(tracked):
    one = tracked(wait_s=0.001)
    one.hear((0, SECOND))
    for _ in range(3):
        assert one.pose_at(SECOND + 500 * MS) is None
    one.odometry.wait_s = 3600.0
    assert one.pose_at(SECOND + 500 * MS) is None
    one.hear((1, SECOND + 100 * MS))
    waiting, found = one.wait_for_pose(SECOND + 150 * MS)
    waiting.join(0.05)
    assert not found
    one.hear((2, SECOND + 200 * MS))
    waiting.join(10)
    assert found[0].position[0] == 1.5


@pytest.mark.parametrize(('ahead_s', 'told'), [(100, '90.0 s later'), (2, '8.0 s earlier')])
def test_odometry_by_another_clock_is_reported(tracked, ahead_s, told):
    one = tracked()
    one.hear((0, ahead_s * SECOND))
    for _ in range(20):
        assert not one.warning.called and one.pose_at(10 * SECOND) is None
    assert told in one.warning.call_args.args[0]
    assert one.odometry.without_pose == 20


def test_odometry_that_is_not_a_pose_or_has_no_stamp_is_one_warning(tracked):
    one = tracked()
    one.hear((float('nan'), SECOND), (1, 0))
    assert not one.odometry.heard
    assert all(call.kwargs['once'] for call in one.warning.call_args_list)


def test_odometry_of_another_frame_waits_for_tf_and_is_then_carried_or_left_out(tracked):
    one = tracked()
    one.hear((0, SECOND), (1, 4 * SECOND - 1), child='imu')
    assert not one.odometry.heard and not one.warning.called
    one.hear((1, 4 * SECOND), child='imu')
    assert 'poses are of imu' in one.warning.call_args.args[0]
    assert one.warning.call_args.kwargs['once'] and not one.odometry.heard
    soon = tracked()
    soon.hear((0, SECOND), child='imu')
    soon.bases['imu'] = Pose((0.0, 2.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    soon.hear((1, 2 * SECOND), child='imu', frame_id='/odom')
    assert soon.odometry.frame_id == 'odom'
    assert soon.pose_at(2 * SECOND).position == (1.0, 2.0, 0.0) and not soon.warning.called


def test_odometry_in_axes_of_a_lens_is_told_after_20_m(tracked):
    one = tracked()
    for step in range(21):
        assert not one.warning.called
        message = odometry(0, (1 + step) * SECOND)
        message.pose.pose.position.z = float(step)
        one.odometry._subscription.hear(message)
    assert 'poses move along their own z (20 of 20 m)' in one.warning.call_args.args[0]
    assert one.warning.call_args.kwargs['once']


LENS = SimpleNamespace(x=-0.5, y=0.5, z=-0.5, w=0.5)  # x right, y down, z ahead: REP-103


class Buffer:
    def __init__(self):
        self.known, self.asked, self.stamp_ns, self.turn = False, 0, 0, LENS

    def can_transform(self, target, source, _time):
        self.asked += 1
        return self.known and {target, source} == {'base_link', 'lens'}

    def lookup_transform(self, *_frames):
        at = SimpleNamespace(x=0.3, y=0.0, z=1.2)
        moved = SimpleNamespace(translation=at, rotation=self.turn)
        header = SimpleNamespace(stamp=stamp_from_ns(self.stamp_ns))
        return SimpleNamespace(header=header, transform=moved)


@pytest.fixture
def node():
    said = []
    logger = SimpleNamespace(info=said.append, warning=said.append)
    return SimpleNamespace(get_logger=lambda: logger, said=said)


@pytest.fixture
def mount(node, monkeypatch):
    """Return a mount by TF, which knows the frame of the lens once it is told so."""
    monkeypatch.setitem(sys.modules, 'tf2_ros', None)
    assert Mount(node, 'base_link').base_in('lens') is None
    tf = SimpleNamespace(Buffer=Buffer, TransformListener=lambda _buffer, _node: None)
    monkeypatch.setitem(sys.modules, 'tf2_ros', tf)
    made = Mount(node, 'base_link')
    assert made.of('lens') is None and made.of('') is None and made.base_in('lens') is None
    made._buffer.known = True
    return made


def test_a_lens_frame_that_looks_ahead_gives_a_mount_without_rotation(node, mount):
    pose = mount.of('/lens')  # as by ROS 1; TF 2 has no slash
    assert pose.position == pytest.approx((0.3, 0.0, 1.2))
    assert pose.orientation == pytest.approx((0, 0, 0, 1), abs=1e-9)
    asked = mount._buffer.asked
    assert mount.of('lens') is pose and mount._buffer.asked == asked and len(node.said) == 1
    assert mount.of('another') is None


def test_a_frame_of_a_body_is_no_mount_with_one_line(node, mount):
    mount._buffer.turn = SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0)  # as Gazebo's camera_link
    assert mount.of('lens') is None and mount.of('lens') is None
    (line,) = node.said
    assert line.startswith('lens is no optical frame') and 'straight up' in line


def test_only_a_frame_that_does_not_move_on_the_robot_carries_odometry(mount):
    assert mount.base_in('lens').position == (0.3, 0.0, 1.2)
    mount._buffer.stamp_ns = SECOND
    assert mount.base_in('lens') is None
