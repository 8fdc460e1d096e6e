# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Each set of config/cameras.yaml hears its driver, which is played with its names and QoS."""

from pathlib import Path

import cv2
from nav_msgs.msg import Odometry
import numpy as np
import pytest
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, Image
import yaml

SETS = yaml.safe_load((Path(__file__).parents[2] / 'config' / 'cameras.yaml').read_text())
RELIABLE = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
SENSOR = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
SHAPE = 120, 160
# By set and the driver's settings: encoding of images, QoS, and what else is published beside it.
DRIVERS = {
    'usb_cam': ('usb_cam', 'yuv422_yuy2', QoSProfile(depth=100)),
    'usb_cam mjpeg2rgb': ('usb_cam', 'rgb8', QoSProfile(depth=100)),
    'v4l2_camera': ('v4l2_camera', 'rgb8', RELIABLE),
    'v4l2_camera use_sensor_data_qos': ('v4l2_camera', 'rgb8', SENSOR),
    'realsense': ('realsense', 'rgb8', RELIABLE),
    'realsense color_qos:=SENSOR_DATA': ('realsense', 'rgb8', SENSOR),
    'zed': ('zed', 'bgra8', RELIABLE),
    'oak': ('oak', 'bgr8', RELIABLE),
    'phone': ('phone', 'bgr8', RELIABLE),
}
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
FROM_GREY = {
    'rgb8': cv2.COLOR_GRAY2RGB, 'bgr8': cv2.COLOR_GRAY2BGR, 'bgra8': cv2.COLOR_GRAY2BGRA,
}  # fmt: skip


def picture(gray: np.ndarray, encoding: str) -> Image:
    if encoding == 'yuv422_yuy2':
        data = np.stack([gray, np.full_like(gray, 128)], axis=-1)
    else:
        data = cv2.cvtColor(gray, FROM_GREY[encoding])
    return filled(data, encoding)


def filled(data: np.ndarray, encoding: str) -> Image:
    height, width = data.shape[:2]
    message = Image(height=height, width=width, encoding=encoding, data=data.tobytes())
    message.step = data.nbytes // height
    message.header.stamp.sec, message.header.frame_id = 1, 'camera'
    return message


@pytest.mark.parametrize('driver', DRIVERS)
def test_the_launch_arguments_of_a_driver_match_its_topics(client, vpr, street, map_path, driver):
    name, encoding, qos = DRIVERS[driver]
    image, info, odometry = TOPICS[name]
    publish = {image: client.node.create_publisher(Image, image, qos)}
    messages = {image: picture(street[3], encoding)}
    header = messages[image].header
    for kind, topic in ((CameraInfo, info), (Odometry, odometry)):
        if topic:
            publish[topic] = client.node.create_publisher(kind, topic, RELIABLE)
            messages[topic] = kind(header=header)
    if info:
        k = [150.0, 0.0, SHAPE[1] / 2, 0.0, 150.0, SHAPE[0] / 2, 0.0, 0.0, 1.0]
        messages[info] = CameraInfo(
            header=header, height=SHAPE[0], width=SHAPE[1], k=k, distortion_model='plumb_bob',
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
    for topic in [*[*publish][1:], image]:
        publish[topic].publish(messages[topic])
    context = node._frame_context
    client.wait_for(lambda: node._counters.processed == 1)
    assert not node._counters.unreadable and node._topic == image
    if info:
        client.wait_for(lambda: context.camera.is_calibrated)
    assert context.odometry._subscription.topic == (odometry or '/odom')


def test_every_set_of_camera_topics_is_tested():
    assert {name for name, *_ in DRIVERS.values()} == TOPICS.keys() == SETS.keys()
