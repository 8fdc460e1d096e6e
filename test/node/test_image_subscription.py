# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The type of images is that which is published, and reliability follows the camera."""

from itertools import count
import threading
from unittest.mock import Mock

from convseq_ros.config.node_config import NodeConfig
from convseq_ros.errors import ConfigError
from convseq_ros.node.inputs import image_subscription
from convseq_ros.node.inputs.following_subscription import FollowingSubscription
from convseq_ros.node.inputs.image_subscription import image_subscriptions
import cv2
import numpy as np
import pytest
from rclpy.duration import Duration
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CompressedImage, Image
from std_msgs.msg import Empty

BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)


def wait_for_reliability(client, wanted):
    """Wait until the graph shows one subscription, of this reliability."""

    def shown():
        infos = client.node.get_subscriptions_info_by_topic('/image')
        return [info.qos_profile.reliability for info in infos] == [wanted]

    client.wait_for(shown, wanted)


def test_a_camera_that_is_named_twice_is_refused():
    node = Mock(resolve_topic_name=lambda name: f'/{name.lstrip("/")}')
    with pytest.raises(ConfigError, match='image_topics: /front is there twice; name each once'):
        image_subscriptions(node, NodeConfig(image_topics='/front /rear front'), Mock())


@pytest.mark.parametrize(
    ('words', 'parameters', 'told'),
    [
        (('-r', 'image:=/odom'), {}, '/odom: it cannot carry both .*/Image and .*/Odometry; give'),
        (('-r', 'odom:=/camera_info'), {}, '/camera_info: it cannot carry both .*/Odometry and'),
        ((), {'image_topics': '/odom'}, '/odom: it cannot carry both'),
        (('-r', 'image:=/clock'), {'use_sim_time': True}, '/clock: it cannot carry both .*/Clock'),
        (('-r', 'image:=/diagnostics'), {}, '/diagnostics: it cannot carry both .*/Image and'),
        (('-r', 'odom:=/vpr_node/answer'), {}, '/vpr_node/answer: it cannot carry both'),
        (('-r', 'image:=/rosout'), {}, '/rosout: it cannot carry both .*/Log and .*/Image'),
    ],
)
def test_one_topic_for_two_types_is_refused(vpr, map_path, words, parameters, told):
    with pytest.raises(ConfigError, match=told):
        vpr(*words, map_path=map_path, **parameters)


def test_a_camera_that_returns_with_reliable_qos_gets_a_reliable_subscription(
    client, vpr, street, image
):
    node = vpr()
    camera = client.node.create_publisher(Image, '/image', BEST_EFFORT)
    wait_for_reliability(client, ReliabilityPolicy.BEST_EFFORT)
    client.wait_for(camera.get_subscription_count)
    client.node.destroy_publisher(camera)
    wait_for_reliability(client, ReliabilityPolicy.RELIABLE)
    client.camera(Image).publish(image(street[0], 1))
    client.wait_for(lambda: node._counters.received == 1)
    wait_for_reliability(client, ReliabilityPolicy.RELIABLE)  # and it stays so


def test_compressed_images_are_known_by_the_type_that_is_published(client, vpr, street, image):
    node = vpr('-r', 'image:=/phone/jpeg')
    client.wait_for(lambda: node._listening)
    assert node._images[0].kind is Image
    camera = client.node.create_publisher(CompressedImage, '/phone/jpeg', 10)
    client.wait_for(camera.get_subscription_count)
    client.wait_until_known_to('/vpr_node')
    jpeg = cv2.imencode('.jpg', street[0])[1].tobytes()
    camera.publish(CompressedImage(header=image(street[0], 1).header, format='jpeg', data=jpeg))
    client.wait_for(lambda: node._counters.processed == 1)
    assert not node._counters.unreadable


def test_images_lost_from_a_full_history_are_counted(client, vpr, street, image):
    node = vpr(queue_size=3)
    camera = client.camera(Image)
    camera.publish(image(street[0], 1))
    client.wait_for(lambda: node._counters.received == 1)
    # The thread that listens is kept busy.
    begun, ended = threading.Event(), threading.Event()
    FollowingSubscription(node, Empty, '/busy', lambda _: begun.set() or ended.wait(60), 1)
    client.camera(Empty, '/busy').publish(Empty())
    assert begun.wait(60)
    for number in range(50):
        camera.publish(image(street[0], number + 2))
    assert camera.wait_for_all_acked(Duration(seconds=60))
    ended.set()
    client.wait_for(lambda: node._counters.received + node._lost() == 51)
    assert node._lost() > 0


def test_large_images_leave_less_room_in_the_history(client, vpr, image, monkeypatch):
    monkeypatch.setattr(image_subscription, 'QUEUE_BYTES', 1_000_000)
    node = vpr(queue_size=20)
    camera = client.camera(Image)
    camera.publish(image(np.zeros((199, 500), np.uint8), 1))
    client.wait_for(lambda: node._images[0]._depth == 10)
    camera.publish(image(np.zeros((2000, 1000), np.uint8), 2))
    client.wait_for(lambda: node._images[0]._depth == 2)
    client.wait_for(lambda: node._counters.received == 2)
    client.wait_for(lambda: client.node.count_subscribers('/image') == 1)
    client.wait_for(camera.get_subscription_count)
    stamps = count(3)

    def received() -> bool:  # a new subscription may know its publisher later than it is known
        camera.publish(image(np.zeros((200, 500), np.uint8), next(stamps)))
        return node._counters.received > 2

    client.wait_for(received)
