# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is found in a list of topics, their types and publishers, without a graph."""

from convseq_ros.node.offers import (
    CAMERA_INFO,
    COMPRESSED_IMAGE,
    IMAGE,
    ODOMETRY,
    Offer,
    Search,
    without_ours,
)  # fmt: skip
import pytest


def images(*topics):
    return [Offer(topic, IMAGE) for topic in topics]


def jpegs(*topics):
    return [Offer(topic, COMPRESSED_IMAGE) for topic in topics]


def infos(*topics):
    return [Offer(topic, CAMERA_INFO) for topic in topics]


def odometries(*topics):
    return [Offer(topic, ODOMETRY) for topic in topics]


def found(offers, namespace='/', **other):
    return Search(offers, namespace, **other).images()


def test_a_robot_has_the_camera_of_its_namespace_alone():
    robots = images('/robot1/camera/image_raw', '/robot2/camera/image_raw', '/robot10/image')
    assert found(robots, '/robot1/') == ['/robot1/camera/image_raw']
    assert found(robots[1:], '/robot1/') == []
    assert found(robots[:2]) == ['/robot1/camera/image_raw', '/robot2/camera/image_raw']


def test_the_topic_image_is_preferred():
    assert found(images('/camera/color/image_raw', '/image')) == ['/image']
    assert found(images('/r/a/image_raw', '/r/image'), '/r/') == ['/r/image']


def test_the_raw_topic_of_image_transport_is_preferred():
    forms = jpegs(*(f'/camera/image_raw/{it}' for it in ('compressed', 'compressedDepth', 'zstd')))
    assert found([*forms, *images('/camera/image_raw')]) == ['/camera/image_raw']
    assert found(forms) == ['/camera/image_raw/compressed']


def test_compressed_images_are_known_by_their_type():
    assert found(jpegs('/phone/jpeg')) == ['/phone/jpeg']
    assert found([Offer('/scan', 'sensor_msgs/msg/LaserScan')]) == []


@pytest.mark.parametrize('picture', ['/robot1/vpr_node/debug_image', '/drawn'])
def test_topics_that_a_vpr_node_publishes_are_left_out(picture):
    offers = [Offer(picture, IMAGE, ('/robot1/vpr_node',)), *images('/robot1/vpr_node2/image')]
    left = without_ours(offers, ['/robot1/vpr_node/match_index', picture])
    assert left == offers[1:]


@pytest.mark.parametrize(
    ('offered', 'taken'),
    [
        (['/front/camera_info', '/camera_info'], ['/front/camera_info']),
        (['/camera_info', '/spare/camera_info'], ['/camera_info']),
        (['/spare/camera_info'], ['/spare/camera_info']),
        (['/b/camera_info', '/a/camera_info'], ['/a/camera_info', '/b/camera_info']),
        (['/rear/camera_info'], []),  # that of another camera
    ],
)  # fmt: skip
def test_a_camera_has_the_calibration_beside_it_or_one_that_belongs_to_no_other(offered, taken):
    offers = [*images('/front/image_raw', '/rear/image_raw'), *infos(*offered)]
    assert Search(offers, '/').camera_infos('/front/image_raw') == taken


def test_the_calibration_beside_a_camera_outside_of_the_namespace_is_its_own():
    offers = infos('/front/camera_info', '/robot1/camera_info')
    assert Search(offers, '/robot1/').camera_infos('/front/image_raw') == ['/front/camera_info']


@pytest.mark.parametrize(
    ('namespace', 'offered', 'taken'),
    [
        ('/', ['/robot1/odom', '/robot2/odom'], ['/robot1/odom']),
        ('/', ['/robot1/odom', '/odom'], ['/odom']),
        ('/', ['/wheels/odom'], ['/wheels/odom']),
        ('/robot1/', ['/robot2/odom', '/odom'], []),
        ('/robot1/', ['/robot1/a', '/robot1/b'], ['/robot1/a', '/robot1/b']),
    ],
)
def test_odometry_of_the_robots_namespace_is_taken(namespace, offered, taken):
    search = Search(odometries(*offered), namespace)
    assert search.odometries('/robot1/camera/image_raw') == taken
