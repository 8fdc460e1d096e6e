# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where camera and odometry of a recording are on the robot, by its /tf_static."""

from dataclasses import replace
import math

from convseq_ros.core.rigid import of_roll_pitch_yaw
from convseq_ros.sources import open_annotated
from convseq_ros.sources.mount import as_parameter, mount_of, StaticTransforms, Tf
import pytest
import recordings

KINDS = recordings.ROS2.types
STILL = (0.0, 0.0, 0.0, 1.0)
AS_A_LENS = (-0.5, 0.5, -0.5, 0.5)  # x right, y down, z ahead, in a frame with x ahead and z up
TO_THE_LEFT = (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))


def transform(parent, child, position=(0.0, 0.0, 0.0), turn=STILL):
    point = KINDS['geometry_msgs/msg/Vector3'](*position)
    rotation = KINDS['geometry_msgs/msg/Quaternion'](*turn)
    moved = KINDS['geometry_msgs/msg/Transform'](point, rotation)
    header = recordings.header(0, parent)
    return KINDS['geometry_msgs/msg/TransformStamped'](header, child, moved)


def tf(*transforms):
    return KINDS['tf2_msgs/msg/TFMessage'](list(transforms))


SIDEWAYS = tf(
    transform('base_link', 'mast', (0.2, 0.0, 0.9)),
    transform('mast', 'camera_link', (0.1, 0.5, 0.0), TO_THE_LEFT),
    transform('camera_link', 'camera_optical', turn=AS_A_LENS),
)
OF_BODY = tf(transform('base_link', 'camera_optical', (0.3, 0.0, 0.9), TO_THE_LEFT))
MOUNT = '0.3 0.5 0.9 0 0 1.5708'  # metres and radians
INFO = recordings.camera_info((50.0, 0, 16, 0, 50, 12, 0, 0, 1), frame='camera_optical')


@pytest.fixture
def opened(write, pictures):
    """Return what opens a recording with transforms; it returns the mount, and what was told."""

    def open_with(*messages, topic='/tf_static', layout='mcap file', camera='/info', **how):
        rows = recordings.drive(pictures[:2])
        rows += [('/info', 1, INFO), *((topic, 1, message) for message in messages)]
        path, told = write(layout, rows), []
        source = open_annotated(path, camera_info=camera, tf=Tf(tell=told.append, **how))
        (mount,) = {frame.camera.mount for frame in source}
        return mount, [line.removeprefix(f'{path}: ') for line in told]

    return open_with


@pytest.mark.parametrize('layout', ['mcap folder', 'db3 file'])
@pytest.mark.parametrize('topic', ['/tf_static', '/robot1/tf_static'])
def test_a_camera_that_looks_sideways_has_the_mount_of_tf_static(opened, layout, topic):
    mount, told = opened(SIDEWAYS, topic=topic, layout=layout)
    assert as_parameter(mount) == MOUNT
    assert mount.position == pytest.approx((0.3, 0.5, 0.9))
    assert mount.orientation == pytest.approx(TO_THE_LEFT)
    assert told == [
        f'camera_to_base is "{MOUNT}", as /tf_static places camera_optical in base_link'
    ]


@pytest.mark.parametrize(
    ('how', 'told'),
    [
        ({'camera_to_base': '0 0 0 0 0 0'},
         [f'/tf_static places camera_optical at "{MOUNT}" in base_link; camera_to_base was '
          'given and counts']),
        ({'base_frame': 'base_footprint'},
         ['/tf_static has no way from base_footprint to camera_optical; name another '
          '--base-frame, or give --camera-to-base']),
        ({'topic': '/tf', 'layout': 'mcap plain'}, []),  # what moves does not count
    ],
)  # fmt: skip
def test_a_given_mount_overrides_tf_static_and_a_missing_transform_is_reported(opened, how, told):
    assert opened(SIDEWAYS, **how) == (None, told)


def test_a_body_frame_where_an_optical_one_belongs_is_told_and_not_used(opened):
    """As Gazebo publishes it: x is ahead in `camera_link`, so the lens would look straight up."""
    mount, (line,) = opened(OF_BODY)
    assert mount is None and line.startswith('camera_optical is no optical frame')
    assert 'straight up' in line and 'set camera_to_base' in line


def test_a_given_mount_overrides_a_frame_that_is_no_optical_one(opened):
    assert 'given and counts' in opened(OF_BODY, camera_to_base='0 0 0 0 0 0')[1][0]


@pytest.mark.parametrize('degrees', [45, 60, -90])
def test_a_camera_that_looks_up_a_little_or_down_is_used(opened, degrees):
    pitched = of_roll_pitch_yaw((0.0, 0.0, 0.0), 0.0, math.radians(-degrees), 0.0)
    up = tf(
        transform('base_link', 'camera_link', turn=pitched.orientation),
        transform('camera_link', 'camera_optical', turn=AS_A_LENS),
    )
    mount, told = opened(up)
    assert mount is not None and told[0].startswith('camera_to_base is')


@pytest.mark.parametrize(
    ('how', 'told'),
    [({}, []), ({'base_frame': 'nope'}, ['has no /tf_static; --base-frame nope is not used'])],
)
def test_without_tf_static_only_a_frame_that_was_named_is_reported(opened, how, told):
    assert opened(**how) == (None, told)


def test_a_camera_of_a_file_is_in_the_frame_of_the_images(opened, tmp_path):
    calibration = tmp_path / 'calib.txt'
    calibration.write_text('P0: 50 0 16 0 0 50 12 0 0 0 1 0\n')
    of_images = tf(transform('base_link', 'camera', (1.0, 0.0, 0.0), AS_A_LENS))
    mount, _ = opened(of_images, camera=str(calibration))
    assert as_parameter(mount) == '1 0 0 0 0 0'


def test_the_last_transform_of_a_frame_counts_and_transforms_are_chained():
    first = tf(transform('/base_link', 'camera', (1.0, 0.0, 0.0), AS_A_LENS))
    last = tf(transform('mast', 'camera', (0.0, 0.0, 2.0), AS_A_LENS))
    mast = tf(transform('base_link', 'mast', (3.0, 0.0, 0.0)))
    lens = StaticTransforms([first, last, mast]).pose_in('base_link', '/camera')
    assert as_parameter(mount_of(lens)) == '3 0 2 0 0 0'


def test_transforms_are_chained_through_a_common_parent_and_a_circle_or_nan_gives_none():
    ahead = transform('body', 'base', (1.0, 0.0, 0.0))
    branches = tf(ahead, transform('body', 'lens', (3.0, 0.0, 0.0)))
    assert StaticTransforms([branches]).pose_in('base', 'lens').position == (2.0, 0.0, 0.0)
    circle = tf(transform('a', 'b'), transform('b', 'a'))
    assert StaticTransforms([circle]).pose_in('base', 'a') is None
    broken = tf(transform('base', 'lens', (math.nan, 0.0, 0.0)))
    assert StaticTransforms([broken]).pose_in('base', 'lens') is None


def test_a_mount_is_written_as_the_six_numbers_of_the_parameter():
    mount = of_roll_pitch_yaw((1.0, -2.0, 3.0), 0.1, -0.2, 3.0)
    assert as_parameter(mount) == '1 -2 3 0.1 -0.2 3'


IMU = tf(transform('base_link', 'imu', (0.0, 2.0, 0.0), TO_THE_LEFT))


@pytest.fixture
def posed(write, pictures):
    """Return what opens a recording with odometry; it returns its poses, and what was said."""

    def open_with(*messages, child='imu', **how):
        rows = recordings.drive(pictures[:2])
        for at in range(2):
            moved = recordings.odometry(float(at), recordings.START_NS + recordings.STEP_NS * at)
            rows.append(('/odom', 1, replace(moved, child_frame_id=child)))
        rows += [('/tf_static', 1, message) for message in messages]
        path, told = write('mcap file', rows), []
        source = open_annotated(path, odom='/odom', tf=Tf(tell=told.append, **how))
        return [frame.pose for frame in source], source.warnings, told

    return open_with


def test_odometry_of_another_frame_is_carried_to_the_base(posed):
    poses, warnings, (told,) = posed(IMU, child='/imu')
    # The base is 2 m along its own right, which is the x of the IMU, turned by 0.6, 0.8 about z.
    assert poses[1].position == pytest.approx((1.0 - 2 * 0.28, 2.0 - 2 * 0.96, 3.0))
    yaw = 2 * math.atan2(0.6, 0.8) - math.pi / 2
    assert poses[1].yaw_rad == pytest.approx(yaw)
    assert told.endswith('/odom: poses of imu are carried to base_link by static TF')
    assert not warnings


@pytest.mark.parametrize('messages', [(), (SIDEWAYS,)])
def test_odometry_that_cannot_be_carried_is_left_out_with_one_line(posed, messages):
    poses, (warning,), told = posed(*messages)
    assert poses == [None, None] and not told
    assert warning.startswith('/odom: poses are of imu') and 'base_link: they are left' in warning


@pytest.mark.parametrize(
    ('child', 'how'),
    [('', {}), ('base_link', {}), ('robot1/base_footprint', {}), ('imu', {'base_frame': '/imu'})],
)
def test_odometry_of_the_robot_itself_stays_as_it_is(posed, child, how):
    poses, warnings, _ = posed(child=child, **how)
    assert poses[1].position == (1.0, 2.0, 3.0) and not warnings
