# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The player publishes every image of a recording, in time, with /clock."""

import signal
import time

import pytest

pytest.importorskip('rosbags')

from convseq_ros.node.conversions import stamp_from_ns, stamp_to_ns
from convseq_ros.sources.images import image_pixels
import cv2
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
import numpy as np
from pictures import written
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_msgs.msg import Header, Int32

SECOND = 1_000_000_000
START_NS = 1_700_000_000 * SECOND
STEP_NS = 3 * SECOND // 10
BEST_EFFORT = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)


def record(path, messages, **others):
    """Write images and the times at which they were recorded, and messages of other topics."""
    store = get_typestore(Stores.ROS2_JAZZY)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic, rows in {'camera': messages, **others}.items():
            kind = type(rows[0][1])
            name = f'{kind.__module__.partition(".")[0]}/msg/{kind.__name__}'
            connection = writer.add_connection(f'/{topic}', name, typestore=store)
            for time_ns, message in rows:
                writer.write(connection, time_ns, serialize_message(message))


@pytest.fixture(scope='module')
def pictures(street):
    """Return larger pictures: Fast DDS acknowledges small ones every 3 s only."""
    return [cv2.resize(gray, (320, 240)) for gray in street]


@pytest.fixture
def recording(tmp_path, pictures, image):
    """Return a recording of ten images, 0.3 s apart."""
    path = tmp_path / 'drive'
    stamps = [START_NS + index * STEP_NS for index in range(10)]
    record(path, [(stamp, image(pictures[i], stamp)) for i, stamp in enumerate(stamps)])
    return path


def stamps_of(messages):
    return [stamp_to_ns(message.header.stamp) for message in messages]


def hear(client, start, kind, topic, *args, told=None):
    """Return what a subscriber gets of a whole run of the player; add to `told` what it says."""
    messages = []
    subscription = client.node.create_subscription(kind, topic, messages.append, 1000)
    process = start('player', *args)
    client.wait_for(lambda: process.poll() is not None, 'the end of the player')
    _, errors = process.communicate()
    assert process.returncode == 0, errors
    if told is not None:
        told += errors.splitlines()
    # All of it has arrived, or the player had not ended; it need not have been looked at yet.
    while taken := subscription.handle.take_message(kind, False):
        messages.append(taken[0])
    return messages


def test_every_image_arrives_unchanged(client, start, recording, pictures):
    messages = hear(client, start, Image, '/camera', recording, '--rate', 10)
    assert stamps_of(messages) == [START_NS + index * STEP_NS for index in range(10)]
    for message, gray in zip(messages, pictures, strict=False):
        assert np.array_equal(image_pixels(message), gray)


def test_a_topic_is_played_under_another_name(client, start, recording):
    rules = '--remap', '/camera:=/front', '--remap', '/other:=/rear'
    told = []
    heard = hear(client, start, Image, '/front', recording, '--rate', 10, *rules, told=told)
    assert len(heard) == 10
    (line,) = told
    assert line.endswith('no topic is /other; those played are /camera, /clock')


def test_compressed_images_keep_the_name_of_their_topic(client, start, pictures, tmp_path):
    png = cv2.imencode('.png', pictures[0])[1].tobytes()
    stamp = stamp_from_ns(START_NS)
    message = CompressedImage(header=Header(stamp=stamp), format='png', data=png)
    record(tmp_path / 'drive', [(START_NS, message)])
    (heard,) = hear(client, start, CompressedImage, '/camera', tmp_path / 'drive')
    assert heard == message


def test_pictures_are_played_on_image_and_unreadable_ones_are_reported(
    client, start, pictures, tmp_path
):
    folder = written(tmp_path / 'pictures', pictures[:3])
    (folder / '001.png').write_text('no picture')
    errors = []
    messages = hear(client, start, Image, '/image', folder, told=errors)
    assert stamps_of(messages) == [SECOND // 10, 3 * SECOND // 10]
    assert {message.header.frame_id for message in messages} == {'camera'}
    (error,) = errors
    assert error.startswith(f'convseq play: {folder / "001.png"}: not a readable picture (data: ')


def test_odometry_and_camera_info_are_played_between_the_images(
    client, start, pictures, image, tmp_path
):
    odometry = []
    for index in range(-12, 20):
        message = Odometry()
        message.header.stamp = stamp_from_ns(START_NS + index * STEP_NS // 2)
        odometry.append((START_NS + index * STEP_NS // 2, message))
    info = CameraInfo(width=320, height=240)
    early_ns = START_NS - 60 * SECOND
    record(
        tmp_path / 'drive',
        [(START_NS + i * STEP_NS, image(pictures[i], START_NS + i * STEP_NS)) for i in range(5)],
        wheels=odometry,
        info=[(early_ns - SECOND, info), (early_ns, info)],
    )
    heard = []
    for kind, topic in ((Odometry, '/wheels'), (CameraInfo, '/info')):
        client.node.create_subscription(kind, topic, heard.append, 1000)
    options = '--rate 10 --odom /wheels --camera-info /info --start 0.3'.split()
    images = hear(client, start, Image, '/camera', tmp_path / 'drive', *options)
    assert stamps_of(images) == [START_NS + index * STEP_NS for index in (1, 2, 3, 4)]
    # The second before the first image, and the last that was said before that.
    played = [message for message in heard if isinstance(message, Odometry)]
    begin_ns = START_NS + STEP_NS - SECOND
    expected = [stamp for stamp, _ in odometry if stamp >= begin_ns]
    assert stamps_of(played)[1:] == expected
    assert begin_ns - STEP_NS // 2 <= stamps_of(played)[0] < begin_ns
    assert stamps_of(message for message in heard if isinstance(message, CameraInfo)) == [early_ns]


def test_the_clock_runs_with_the_images_at_the_rate(client, start, recording):
    clock = []
    client.node.create_subscription(
        Clock, '/clock', lambda message: clock.append(stamp_to_ns(message.clock)), BEST_EFFORT
    )
    before_s = time.monotonic()
    messages = hear(client, start, Image, '/camera', recording, '--rate', 1.5)
    took_s = time.monotonic() - before_s
    # At 1.5 times their speed, 2.7 s take 1.8 s, or longer on a busy machine, but never less.
    assert took_s > 1.8
    assert len(messages) == 10
    assert START_NS <= clock[0]
    assert clock == sorted(clock)
    assert 2.7 * SECOND <= clock[-1] - START_NS < 1.5 * took_s * SECOND
    # Time goes on between images as well; on an idle machine at 100 Hz.
    assert len(clock) > 3 * len(messages)


def test_a_node_on_the_time_of_the_recording_survives_a_loop(client, start, recording, map_path):
    start('vpr_node', map_path=map_path, use_sim_time='true', diagnostics_period_s=0.1)
    heard = client.listen(Int32, '/vpr_node/match_index')
    diagnostics = client.listen(DiagnosticArray, '/diagnostics')
    client.wait_until_known_to('/vpr_node')
    rule = '--remap', '/camera:=/image'
    player = start('player', recording, '--rate', 1.5, '--start', 0.6, '--loop', *rule)
    client.wait_for(lambda: len(heard) >= 12, 'a second round')
    client.wait_for(lambda: START_NS <= stamps_of(diagnostics)[-1] < START_NS + 10 * SECOND)
    player.send_signal(signal.SIGINT)
    assert player.wait(60) == 0
    indices = [message.data for message in heard]
    assert indices[:12] == [-1, 3, 4, 5, 6, 7, 8, 9, -1, 3, 4, 5]


def test_a_recording_is_played_without_subscribers_if_none_are_required(start, recording):
    process = start('player', recording, '--wait-subscribers', 0, '--rate', 100, '--best-effort')
    assert process.communicate(timeout=180) == ('', '')
    assert process.returncode == 0


@pytest.mark.parametrize(
    ('words', 'code', 'reason'),
    [
        ('drive --topic /rear', 1, '/camera'),
        ('drive --odom /wheels', 1, 'no Odometry messages'),
        ('drive --start 99 --wait-subscribers 0', 1, 'no images from --start 99 s on'),
        ('drive --wait-subscribers 0.1', 1, '/camera: nobody subscribes after 0.1 s; start'),
        ('drive --remap /camera:=/clock', 1, '/clock: two topics get this name; --remap one'),
        ('drive --rate 0', 2, '--rate'),
        ('drive --remap /image', 2, "'/image' is not of the form FROM:=TO"),
        ('drive --remap /camera:=/a//b', 2, 'Invalid topic name'),
    ],
)
def test_a_recording_that_cannot_be_played_is_refused_with_the_reason(
    start, recording, words, code, reason
):
    process = start('player', *words.split())
    _, errors = process.communicate(timeout=180)
    assert process.returncode == code
    assert reason in errors and 'Traceback' not in errors
    assert code == 2 or errors.startswith('convseq play: ')
