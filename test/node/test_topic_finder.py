# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Without a named camera the node finds the only one, and names them if there are several."""

from convseq_ros.node import topic_finder
from nav_msgs.msg import Odometry
import pytest
from sensor_msgs.msg import CameraInfo, CompressedImage, Image


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(topic_finder, '_LOOK_S', 0.1)


def offered(client, *topics):
    """Return publishers; all are there before the node is."""
    return [client.node.create_publisher(kind, name, 10) for kind, name in topics]


def test_the_only_camera_is_found_with_what_is_beside_it(client, vpr, street, image, map_path):
    camera, *_ = offered(
        client,
        (Image, '/front/image_raw'),
        (CompressedImage, '/front/image_raw/compressed'),
        (CameraInfo, '/front/camera_info'),
        (CameraInfo, '/back/camera_info'),
        (Odometry, '/wheels/odom'),
    )
    node = vpr(map_path=map_path)
    client.wait_for(camera.get_subscription_count)
    assert node._topic == '/front/image_raw'
    assert node._frame_context.odometry._subscription.topic == '/wheels/odom'
    assert node._frame_context.camera._subscription.topic == '/front/camera_info'
    client.wait_until_known_to('/vpr_node')
    camera.publish(image(street[0], 1))
    client.wait_for(lambda: node._statistics.processed == 1)


def test_a_camera_that_only_sends_jpegs_is_found(client, vpr, map_path):
    (camera,) = offered(client, (CompressedImage, '/front/compressed'))
    node = vpr(map_path=map_path)
    client.wait_for(camera.get_subscription_count)
    assert node._topic == '/front/compressed'


def test_several_cameras_are_named_and_none_is_taken(client, vpr, map_path, capfd):
    offered(client, (Image, '/left/image'), (Image, '/right/image'))
    node = vpr(map_path=map_path)
    client.wait_for(lambda: node._finder._told)
    assert node._topic == '/image'
    assert '-r image:=/left/image or -r image:=/right/image' in node._advice()
    text = []

    def is_said():
        text.extend(capfd.readouterr())
        return (
            '2 camera topics; choose one:\n  -r image:=/left/image\n  -r image:=/right'
            in ''.join(text)
        )

    client.wait_for(is_said)


def test_a_camera_that_was_named_is_waited_for(client, vpr, map_path):
    offered(client, (Image, '/other/image'))
    node = vpr('-r', 'image:=/mine', map_path=map_path)
    client.wait_for(lambda: node._ready)
    assert not hasattr(node._finder, '_timer') and node._topic == '/mine'


def test_what_comes_on_the_usual_topic_is_taken_first(client, vpr, map_path):
    offered(client, (Image, '/other/image'), (Image, '/image'))
    node = vpr(map_path=map_path)
    client.wait_for(lambda: node._listening and node.count_publishers('/other/image'))
    node._finder._look()
    node._finder._look()
    assert node._topic == '/image'
