# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Each set of config/cameras.yaml hears its driver, which is played with its names and QoS."""

from pathlib import Path

from nav_msgs.msg import Odometry
import pytest
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, Image
import yaml

SECOND = 1_000_000_000
SETS = yaml.safe_load((Path(__file__).parents[2] / 'config' / 'cameras.yaml').read_text())
RELIABLE = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
SENSOR = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
TOPICS = {  # by set: image, its CameraInfo, odometry
    'usb_cam': ('/image_raw', '/camera_info', None),
    'v4l2_camera': ('/image_raw', '/camera_info', None),
    'realsense': (
        '/camera/camera/color/image_raw', '/camera/camera/color/camera_info', None,
    ),
    'zed': (
        '/zed/zed_node/rgb/color/rect/image', '/zed/zed_node/rgb/color/rect/camera_info',
        '/zed/zed_node/odom',
    ),
    'oak': ('/oak/rgb/image_raw', '/oak/rgb/camera_info', None),
    'phone': ('/image_raw', None, None),
}  # fmt: skip
# Some drivers can be set to lose images.
DRIVERS = [*((name, RELIABLE) for name in TOPICS), ('v4l2_camera', SENSOR), ('realsense', SENSOR)]


@pytest.mark.parametrize(('name', 'qos'), DRIVERS)
def test_the_launch_arguments_of_a_driver_match_its_topics(
    client, vpr, street, map_path, image, name, qos
):
    seen, info, odometry = TOPICS[name]
    publish = {seen: client.node.create_publisher(Image, seen, qos)}
    messages = {seen: image(street[3], SECOND)}
    header = messages[seen].header
    for kind, topic in ((CameraInfo, info), (Odometry, odometry)):
        if topic:
            publish[topic] = client.node.create_publisher(kind, topic, RELIABLE)
            messages[topic] = kind(header=header)
    if info:
        k = [150.0, 0.0, 80.0, 0.0, 150.0, 60.0, 0.0, 0.0, 1.0]
        messages[info] = CameraInfo(
            header=header, height=120, width=160, k=k, distortion_model='plumb_bob',
            d=[0.0] * 5, p=[*k[:3], 0.0, *k[3:6], 0.0, *k[6:], 0.0],
        )  # fmt: skip
    if odometry:
        messages[odometry].pose.pose.orientation.w = 1.0
        messages[odometry].header.frame_id = 'odom'
    words = [word for at, topic in SETS[name].items() for word in ('-r', f'{at}:={topic}')]
    node = vpr(*words, map_path=map_path, fixed_length=1)
    for topic, publisher in publish.items():
        client.wait_for(publisher.get_subscription_count, f'a subscriber of {topic}')
    client.wait_until_known_to('/vpr_node')
    for topic in [*[*publish][1:], seen]:
        publish[topic].publish(messages[topic])
    context = node._frame_context
    client.wait_for(lambda: node._counters.processed == 1)
    assert not node._counters.unreadable and node._topic == seen
    if info:
        client.wait_for(lambda: context.camera.is_calibrated)
    assert context.odometry._subscription.topic == (odometry or '/odom')


def test_every_set_of_camera_topics_is_tested():
    assert TOPICS.keys() == SETS.keys()
