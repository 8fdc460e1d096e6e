# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whole recordings: storages, topics, stamps, raw messages, poses."""

from dataclasses import replace
from pathlib import Path
import sys
from unittest.mock import Mock

from convseq_ros.cli.recording import recording_lines
from convseq_ros.core.types import Pose
from convseq_ros.errors import ConvseqError, SourceError
from convseq_ros.sources import open_annotated, open_source
from convseq_ros.sources import recording as module
from convseq_ros.sources.recording import read_poses, Recording
from convseq_ros.sources.topic_rank import image_rank
from convseq_ros.sources.topics import choose_topic, Topic, typestore
import numpy as np
import pytest
import recordings
from recordings import START_NS, STEP_NS

TOPIC = '/camera/image_raw'


def assert_frames_show(frames, pictures):
    np.testing.assert_array_equal([frame.gray for frame in frames], pictures)


def test_every_layout_gives_the_same_frames_again_and_again(write, layout, pictures):
    rows = [('/chatter', recordings.START_NS, recordings.text()), *recordings.drive(pictures)]
    path = write(layout, rows)
    recording = open_source(path)
    assert isinstance(recording, Recording)
    assert (recording.name, recording.topic, len(recording)) == (path.name, TOPIC, 12)
    for _ in range(2):
        frames = list(recording)
        assert_frames_show(frames, pictures)
        stamps = [recordings.START_NS + recordings.STEP_NS * i for i in range(12)]
        assert [frame.stamp_ns for frame in frames] == stamps
        assert {frame.source for frame in frames} == {TOPIC}
        assert not any(frame.problem for frame in frames)
    assert recording.warnings == []


def test_raw_messages_are_cdr_with_time_and_type(write, layout, pictures):
    path = write(layout, recordings.drive(pictures))
    messages = list(Recording(path, TOPIC).messages())
    assert len(messages) == 12
    for i, (log_time_ns, type_name, cdr) in enumerate(messages):
        stamp_ns = recordings.START_NS + recordings.STEP_NS * i
        assert type_name == 'sensor_msgs/msg/Image'
        assert log_time_ns == stamp_ns + 5_000_000
        assert messages[i].stamp_ns == stamp_ns
        image = recordings.ROS2.deserialize_cdr(cdr, type_name)
        np.testing.assert_array_equal(image.data.reshape(24, 32), pictures[i])
        assert image.header.frame_id == 'camera'


@pytest.mark.parametrize('storage', ['mcap folder', 'db3 file', 'ros1 bag'])
@pytest.mark.parametrize('name', ['png', 'bgr8; png compressed bgr8'])
def test_compressed_topics_are_read(write, storage, name, pictures):
    images = [recordings.compressed(gray, i + 1, name=name) for i, gray in enumerate(pictures)]
    rows = [('/camera/image_raw/compressed', i, image) for i, image in enumerate(images)]
    recording = open_source(write(storage, rows))
    assert recording.type_name == 'sensor_msgs/msg/CompressedImage'
    assert_frames_show(list(recording), pictures)


def two_cameras(pictures):
    rows = recordings.drive(pictures[:4], '/left/image_raw')
    rows += recordings.drive(pictures[4:], '/right/image_raw')
    rows.append(('/chatter', recordings.START_NS, recordings.text()))
    return sorted(rows, key=lambda row: row[1])


@pytest.mark.parametrize('wanted', ['/right/image_raw', 'right/image_raw'])
def test_only_the_given_topic_is_read(write, wanted, pictures):
    path = write('mcap folder', two_cameras(pictures))
    recording = open_source(path, wanted)
    assert recording.topic == '/right/image_raw' and len(recording) == 8
    assert_frames_show(list(recording), pictures[4:])


@pytest.mark.parametrize('storage', ['mcap file', 'mcap folder', 'sqlite3 folder', 'ros1 bag'])
@pytest.mark.parametrize(
    ('wanted', 'problem'),
    [
        ('', '2 topics could be meant; add'),
        ('/front', "no topic '/front'; use"),
        ('/chatter', "topic '/chatter' is of type std_msgs/msg/String; use"),
    ],
)
def test_image_topics_are_listed_ready_to_paste(write, storage, wanted, problem, pictures):
    path = write(storage, two_cameras(pictures))
    with pytest.raises(SourceError) as caught:
        open_source(path, wanted)
    topics = '--topic /left/image_raw or --topic /right/image_raw'
    assert str(caught.value) == f'{path}: {problem} {topics}'


@pytest.mark.parametrize('wanted', ['', '/camera'])
@pytest.mark.parametrize('storage', ['mcap folder', 'mcap file', 'db3 file', 'ros1 bag'])
def test_a_recording_without_images_names_what_it_has(write, storage, wanted):
    path = write(storage, [('/chatter', 1, recordings.text())])
    with pytest.raises(SourceError, match=r'/chatter \(std_msgs/msg/String\)') as caught:
        open_source(path, wanted)
    assert '\n' not in str(caught.value)


def test_images_of_a_format_that_is_not_read_are_one_line(write, pictures):
    depth = [recordings.image(gray, encoding='32FC1') for gray in pictures]
    with pytest.raises(SourceError, match=rf"mcap: images of {TOPIC}: encoding: '32FC1' is not"):
        list(open_source(write('mcap file', [(TOPIC, 1, message) for message in depth])))


@pytest.mark.parametrize(
    ('option', 'name', 'kind', 'line'),
    [
        ('--topic', '/cam/h264', 'foxglove_msgs/msg/CompressedVideo', 'is video, or a picture'),
        ('--odom', '/tf', 'tf2_msgs/msg/TFMessage', 'has transforms, not poses: `evo_traj bag2'),
        ('--odom', '/tf_static', 'tf2_msgs/msg/TFMessage', None),
        ('--topic', '/tf', 'tf2_msgs/msg/TFMessage', None),
    ],
)
def test_video_and_transforms_are_named_with_the_remedy(option, name, kind, line):
    topic = Topic(name, kind, 3)
    with pytest.raises(SourceError) as caught:
        choose_topic(Path('x.mcap'), {name: topic}, '', ('a/msg/B',), option)
    end = f'it holds {name} ({kind})'
    assert (f'{end}; {name} {line}' if line else end) in str(caught.value)
    assert bool(line) == (not str(caught.value).endswith(end))
    facts = {'recording': 'x', 'images': 0, 'seconds': 1.0, 'warnings': [], 'use': {option: []}}
    facts['topics'] = [{'topic': name, 'type': kind, 'messages': 3, 'rate_hz': 1.0}]
    told = [one for one in recording_lines(facts) if one.startswith(f'{name} ')]
    assert [line in one for one in told] == ([True] if line else [])


def test_time_of_recording_stands_in_for_missing_stamps_with_one_warning(write, layout, pictures):
    rows = [(TOPIC, 1000 + i, recordings.image(gray, 0)) for i, gray in enumerate(pictures)]
    recording = open_source(write(layout, rows))
    for _ in range(2):
        assert [frame.stamp_ns for frame in recording] == [1000 + i for i in range(12)]
    (line,) = recording.warnings
    assert 'no stamp' in line


def test_images_that_cannot_be_decoded_are_frames_with_a_problem(write, layout, pictures):
    rows = recordings.drive(pictures[:5])
    bad = {1: {'encoding': '32FC1'}, 2: {'step': 3}, 3: {'data': np.zeros(9, np.uint8)}}
    for i, changes in bad.items():
        rows[i] = (*rows[i][:2], replace(rows[i][2], **changes))
    frames = list(open_source(write(layout, rows)))
    assert [frame.gray is None for frame in frames] == [False, True, True, True, False]
    named = [frame.problem.split(':')[0] for frame in frames]
    assert named == ['', 'encoding', 'step', 'data', '']
    assert [frame.stamp_ns for frame in frames] == [row[1] - 5_000_000 for row in rows]


@pytest.mark.parametrize('storage', ['mcap folder', 'mcap file', 'mcap without chunks'])
def test_frames_stream_without_reading_the_rest(write, storage, pictures, monkeypatch):
    recording = open_source(write(storage, recordings.drive(pictures)))
    decode = Mock(return_value=np.zeros((1, 1), np.uint8))
    monkeypatch.setattr(module, 'message_pixels', decode)
    next(iter(recording))
    assert decode.call_count == 1


@pytest.mark.parametrize('storage', ['mcap folder', 'db3 file', 'ros1 bag'])
def test_odometry_is_read_by_stamp(write, storage, pictures):
    rows = recordings.drive(pictures)
    rows += [('/odom', i, recordings.odometry(float(i), 100 - i)) for i in range(1, 6)]
    poses = read_poses(write(storage, rows), '/odom')
    turn = 0.0, 0.0, 0.6, 0.8
    assert poses == [(100 - i, Pose((float(i), 2.0, 3.0), turn)) for i in (5, 4, 3, 2, 1)]


@pytest.mark.parametrize('kind', ['PoseStamped', 'PoseWithCovarianceStamped'])
def test_stamped_poses_are_read(write, kind):
    odometry = recordings.odometry(7.0, 42)
    pose = odometry.pose.pose if kind == 'PoseStamped' else odometry.pose
    message = recordings.ROS2.types[f'geometry_msgs/msg/{kind}'](odometry.header, pose)
    path = write('mcap folder', [('/pose', 1, message)])
    assert read_poses(path, '') == [(42, Pose((7.0, 2.0, 3.0), (0.0, 0.0, 0.6, 0.8)))]


def test_pictures_beside_a_recording_are_not_mistaken_for_it(write, pictures):
    path = write('mcap folder', recordings.drive(pictures))
    (path / 'preview.png').write_bytes(recordings.compressed(pictures[0]).data.tobytes())
    assert len(open_source(path)) == 12
    (path / 'metadata.yaml').unlink()
    assert open_source(path).topic == ''


@pytest.mark.parametrize('module', ['rosbags', 'mcap'])
def test_a_missing_library_is_one_line_with_the_remedy(write, pictures, monkeypatch, module):
    path = write('mcap file', recordings.drive(pictures))
    path.write_bytes(path.read_bytes()[:-20])
    typestore.cache_clear()
    for name in (f'{module}.typesys', f'{module}.records'):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(ConvseqError, match=f'pip install {module}') as caught:
        open_source(path)
    assert '\n' not in str(caught.value)


# Of drivers and of what works on their images; the first of each is the one for recognition.
REALSENSE = (
    '/camera/color/image_raw', '/camera/infra1/image_rect_raw', '/camera/infra2/image_rect_raw',
    '/camera/depth/image_rect_raw', '/camera/aligned_depth_to_color/image_raw',
)  # fmt: skip
OUSTER = (
    '/camera/image_raw', '/ouster/nearir_image', '/ouster/signal_image', '/ouster/reflec_image',
    '/ouster/range_image',
)  # fmt: skip
ZED = (
    '/zed/rgb/image_rect_color', '/zed/left/image_rect_color', '/zed/right/image_rect_color',
    '/zed/depth/depth_registered', '/zed/confidence/confidence_map',
)  # fmt: skip
KINECT = ('/rgb/image_raw', '/ir/image_raw', '/depth/image_raw', '/depth_to_rgb/image_raw')
SIMULATOR = ('/rgb', '/depth', '/semantic_segmentation')
DETECTOR = ('/front/image_raw', '/yolo/annotated')
NEAR_INFRARED_ALONE = ('/lidar/nearir_image', '/lidar/range_image')


@pytest.mark.parametrize(
    'topics', [REALSENSE, OUSTER, ZED, KINECT, SIMULATOR, DETECTOR, NEAR_INFRARED_ALONE]
)
def test_the_colour_camera_is_best(topics):
    best, *others = sorted(topics, key=image_rank)
    assert best == topics[0] and image_rank(best) < image_rank(others[0])


def test_cameras_of_one_kind_are_equally_good():
    assert image_rank('/left/image_raw') == image_rank('/right/image_rect')


SECOND_NS = 1_000_000_000


def stamped(write, pictures, stamps_ns, layout='mcap file', log_step_ns=STEP_NS):
    """Write images with stamps, recorded a step apart; return path and times of recording."""
    logged = [START_NS + log_step_ns * number for number in range(len(pictures))]
    images = map(recordings.image, pictures, stamps_ns)
    rows = [(TOPIC, *row) for row in zip(logged, images, strict=True)]
    return write(layout, rows), logged


@pytest.mark.parametrize(
    ('stamps', 'told'),
    [
        ([7 * SECOND_NS + 5] * 12, 'one stamp'),
        ([START_NS + SECOND_NS * (at // 10) for at in range(12)], '2 stamps of whole seconds'),
    ],
)
def test_times_of_recording_replace_constant_or_whole_second_stamps(
    write, layout, pictures, stamps, told
):
    path, logged = stamped(write, pictures, stamps, layout)
    source = open_source(path)
    assert isinstance(source, Recording)
    for _ in range(2):
        assert [frame.stamp_ns for frame in source] == logged
    assert [message.stamp_ns for message in source.messages()] == logged
    assert source.warnings == [
        f'{path}: the first 12 messages of {TOPIC} have {told}; the times of recording are taken '
        'instead: check the driver'
    ]


@pytest.mark.parametrize(
    ('stamps', 'log_step_ns'),
    [
        ([START_NS + SECOND_NS * at for at in range(12)], STEP_NS),
        # A driver that sends each image twice.
        ([START_NS + STEP_NS * (at // 2) + 1 for at in range(12)], STEP_NS),
        ([7 * SECOND_NS] * 12, 0),  # times of recording tell no more
        ([7 * SECOND_NS] * 2, STEP_NS),  # two are too few to tell
    ],
)
def test_other_stamps_are_kept(write, pictures, stamps, log_step_ns):
    path, _ = stamped(write, pictures[: len(stamps)], stamps, log_step_ns=log_step_ns)
    source = open_source(path)
    assert [frame.stamp_ns for frame in source] == stamps and source.warnings == []


def test_images_of_one_stamp_get_the_odometry_of_their_time(write, pictures):
    rows = []
    for i, gray in enumerate(pictures):
        time_ns = START_NS + STEP_NS * i
        rows.append((TOPIC, time_ns, recordings.image(gray, SECOND_NS)))
        rows.append(('/odom', time_ns, recordings.odometry(float(i), time_ns)))
    source = open_annotated(write('mcap file', rows), odom='/odom')
    assert [frame.pose.position[0] for frame in source] == list(range(12))
