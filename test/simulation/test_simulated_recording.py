# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is written is what was drawn."""

import math

from convseq_ros.errors import ConvseqError
from convseq_ros.simulation.drive import draw, Drive
from convseq_ros.simulation.recording import write_recording
from convseq_ros.simulation.street import Street
from convseq_ros.sources.recording import read_camera
import numpy as np
import pytest

DRIVE = Drive(num_frames=4, width_px=64, height_px=48, heading_deg=80.0)


@pytest.fixture(scope='module')
def shots():
    return list(draw(Street(100.0, 2), DRIVE))


def read(path):
    rosbags = pytest.importorskip('rosbags.highlevel')
    from rosbags.typesys import get_typestore, Stores

    store = get_typestore(Stores.ROS2_JAZZY)
    with rosbags.AnyReader([path], default_typestore=store) as reader:
        return [
            (connection.topic, stamp, store.deserialize_cdr(data, connection.msgtype))
            for connection, stamp, data in reader.messages()
        ]


def test_images_come_back_pixel_for_pixel(tmp_path, shots):
    write_recording(tmp_path / 'drive', shots, odom_topic='')
    messages = read(tmp_path / 'drive')
    assert len(messages) == len(shots)
    for (topic, stamp, message), shot in zip(messages, shots, strict=True):
        assert topic == '/camera/image_raw'
        header = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
        assert stamp == header == shot.stamp_ns
        assert (message.encoding, message.step) == ('bgr8', 64 * 3)
        assert np.array_equal(message.data.reshape(48, 64, 3), shot.image)


def test_an_existing_folder_is_left_alone(tmp_path, shots):
    (tmp_path / 'drive').mkdir()
    with pytest.raises(ConvseqError, match='exists already'):
        write_recording(tmp_path / 'drive', shots)
    assert not list((tmp_path / 'drive').iterdir())


def test_an_interrupted_recording_leaves_nothing(tmp_path, shots):
    def broken():
        yield shots[0]
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_recording(tmp_path / 'drive', broken())
    assert not list(tmp_path.iterdir())


def test_the_camera_is_described_for_every_image(tmp_path, shots):
    write_recording(tmp_path / 'drive', shots, odom_topic='', info_topic='/camera/camera_info')
    infos = [m for topic, _, m in read(tmp_path / 'drive') if topic == '/camera/camera_info']
    assert len(infos) == len(shots)
    assert shots[0].camera is not None and shots[0].frame.camera == shots[0].camera
    assert read_camera(tmp_path / 'drive') == shots[0].camera
    focal = 32 / math.tan(math.radians(40))
    assert infos[0].k.reshape(3, 3) == pytest.approx(
        np.array(((focal, 0, 32), (0, focal, 24), (0, 0, 1)))
    )
