# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is written is what was drawn; odometry drifts as much as it says."""

from dataclasses import replace
import math

from convseq_ros.errors import ConvseqError
from convseq_ros.simulation.drive import draw, Drive
from convseq_ros.simulation.odometry import Drift, DriftingOdometer, with_odometry
from convseq_ros.simulation.recording import write_recording
from convseq_ros.simulation.street import Street
from convseq_ros.sources.recording import read_camera_in, read_poses
import numpy as np
from poses import at as pose
import pytest

DRIVE = Drive(num_frames=4, width_px=64, height_px=48, heading_deg=80.0)


@pytest.fixture(scope='module')
def shots():
    return list(draw(Street(100.0, 2), DRIVE))


@pytest.fixture
def rosbags():
    return pytest.importorskip('rosbags', reason='needs rosbags: pip install rosbags')


def read(path):
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import get_typestore, Stores

    store = get_typestore(Stores.ROS2_JAZZY)
    with AnyReader([path], default_typestore=store) as reader:
        return [
            (connection.topic, stamp, store.deserialize_cdr(data, connection.msgtype))
            for connection, stamp, data in reader.messages()
        ]


def test_a_recording_holds_each_image_pixel_for_pixel_and_its_camera(rosbags, tmp_path, shots):
    write_recording(tmp_path / 'drive', shots, odom_topic='', info_topic='/camera/camera_info')
    messages = read(tmp_path / 'drive')
    images = [one[1:] for one in messages if one[0] == '/camera/image_raw']
    infos = [one[2] for one in messages if one[0] == '/camera/camera_info']
    assert len(images) == len(infos) == len(shots) == len(messages) / 2
    for (stamp, message), shot in zip(images, shots, strict=True):
        header = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
        assert stamp == header == shot.stamp_ns
        assert (message.encoding, message.step) == ('bgr8', 64 * 3)
        assert np.array_equal(message.data.reshape(48, 64, 3), shot.image)
    assert shots[0].camera is not None and shots[0].frame.camera == shots[0].camera
    assert read_camera_in(tmp_path / 'drive')[0] == shots[0].camera
    focal = 32 / math.tan(math.radians(40))
    expected = np.array(((focal, 0, 32), (0, focal, 24), (0, 0, 1)))
    assert infos[0].k.reshape(3, 3) == pytest.approx(expected)


def test_an_interrupted_recording_leaves_nothing_and_an_existing_folder_is_left_alone(
    rosbags, tmp_path, shots
):
    def broken():
        yield shots[0]
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_recording(tmp_path / 'drive', broken())
    assert not list(tmp_path.iterdir())
    (tmp_path / 'drive').mkdir()
    with pytest.raises(ConvseqError, match='exists already'):
        write_recording(tmp_path / 'drive', shots)
    assert not list((tmp_path / 'drive').iterdir())


NONE = Drift(scale=0.0, yaw_bias_deg=0.0, noise_m=0.0, yaw_noise_deg=0.0)


def yaw_of(pose):
    return 2 * math.atan2(pose.orientation[2], pose.orientation[3])


def straight(drift):
    odometer = DriftingOdometer(drift)
    return [odometer.moved_to(pose(x)) for x in range(101)]


def test_odometry_without_drift_is_the_true_pose_relative_to_the_start():
    odometer = DriftingOdometer(NONE)
    odometer.moved_to(pose(5.0, 3.0, math.pi / 2))
    moved = odometer.moved_to(pose(4.0, 5.0, math.pi))
    assert moved.position == pytest.approx((2.0, 1.0, 0.0))
    assert yaw_of(moved) == pytest.approx(math.pi / 2)


def test_a_scale_error_lengthens_odometry_and_a_yaw_bias_bends_it_to_the_left():
    assert straight(replace(NONE, scale=0.02))[-1].position == pytest.approx((102.0, 0.0, 0.0))
    end, bend = straight(replace(NONE, yaw_bias_deg=5.0))[-1], math.radians(5.0)
    assert yaw_of(end) == pytest.approx(bend)
    assert end.position[0] == pytest.approx(100 / bend * math.sin(bend), abs=0.01)
    assert end.position[1] == pytest.approx(100 / bend * (1 - math.cos(bend)), abs=0.1)


def test_odometry_noise_has_the_standard_deviation_that_was_set():
    drift = replace(NONE, noise_m=0.05, yaw_noise_deg=2.0)
    ends = [straight(replace(drift, seed=seed))[-1] for seed in range(300)]
    along = np.array([end.position[0] - 100 for end in ends])
    turned = np.degrees([yaw_of(end) for end in ends])
    assert turned.std() == pytest.approx(2.0, rel=0.15) and abs(turned.mean()) < 0.4
    assert along.std() == pytest.approx(0.05 * 10, rel=0.2)


def test_a_recording_holds_odometry_and_truth_in_frames_of_their_own(rosbags, tmp_path):
    shots = list(with_odometry(draw(Street(100.0, 2), DRIVE), Drift(seed=1)))
    write_recording(tmp_path / 'drive', shots)
    odometry, truth = [shot.odometry for shot in shots], [shot.pose for shot in shots]
    for topic, poses in (('/odom', odometry), ('/ground_truth', truth)):
        told = read_poses(tmp_path / 'drive', topic)
        assert [stamp for stamp, _ in told] == [shot.stamp_ns for shot in shots]
        for (_, one), other in zip(told, poses, strict=True):
            assert one.position == pytest.approx(other.position)
            assert one.orientation == pytest.approx(other.orientation)
    assert odometry[0].position == (0.0, 0.0, 0.0)
    frames = {topic: one.header.frame_id for topic, _, one in read(tmp_path / 'drive')}
    assert (frames['/odom'], frames['/ground_truth']) == ('odom', 'map')
