# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The node takes its robot's camera, in whatever order drivers start, unless a person chooses."""

from convseq_ros.core.map.reader import open_map
from convseq_ros.node import image_subscription, topic_finder
from convseq_ros.node.offers import offers_of
import cv2
from nav_msgs.msg import Odometry
import numpy as np
import pytest
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

SECOND = 1_000_000_000
LATER_S = 1000


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    for module in (image_subscription, topic_finder):
        monkeypatch.setattr(module, '_PERIOD_S', 0.1)


def offered(client, *topics):
    """Return publishers; all are there before the node is."""
    return [client.node.create_publisher(kind, name, 10) for kind, name in topics]


def used(node):
    """Return the topics that a node listens to: images, camera_info, odometry."""
    context = node._frame_context
    return node._topic, context.camera._subscription.topic, context.odometry._subscription.topic


def test_the_only_camera_is_found_with_what_is_beside_it(client, vpr, street, image, map_path):
    camera, *_ = offered(
        client,
        (Image, '/front/image_raw'),
        (CompressedImage, '/front/image_raw/compressed'),
        (CompressedImage, '/front/image_raw/compressedDepth'),
        (CompressedImage, '/front/image_raw/zstd'),
        (CameraInfo, '/front/camera_info'),
        (CameraInfo, '/back/camera_info'),
        (Odometry, '/wheels/odom'),
    )
    node = vpr(map_path=map_path)
    client.wait_for(camera.get_subscription_count)
    wanted = '/front/image_raw', '/front/camera_info', '/wheels/odom'
    client.wait_for(lambda: used(node) == wanted)
    client.wait_until_known_to('/vpr_node')
    camera.publish(image(street[0], 1))
    client.wait_for(lambda: node._counters.processed == 1)


def test_a_topic_of_jpegs_and_its_calibration_are_found_by_type(
    client, vpr, street, image, map_path
):
    node = vpr('-r', 'image:=/phone/jpeg', map_path=map_path)
    client.wait_for(lambda: node._listening)
    assert node._images[0].kind is Image
    camera, *_ = offered(
        client,
        (CompressedImage, '/phone/jpeg'),
        (Image, '/other/image_raw'),
        (CameraInfo, '/phone/camera_info'),
        (Odometry, '/wheels/odom'),
    )
    client.wait_for(lambda: used(node) == ('/phone/jpeg', '/phone/camera_info', '/wheels/odom'))
    client.wait_for(camera.get_subscription_count)
    client.wait_until_known_to('/vpr_node')
    jpeg = cv2.imencode('.jpg', street[0])[1].tobytes()
    camera.publish(CompressedImage(header=image(street[0], 1).header, format='jpeg', data=jpeg))
    client.wait_for(lambda: node._counters.processed == 1)
    assert not node._counters.unreadable


def test_several_cameras_are_named_and_none_is_taken(client, vpr, map_path, capfd):
    offered(client, (Image, '/left/image'), (Image, '/right/image'))
    node = vpr(map_path=map_path)
    client.wait_for(lambda: node._finder._reported)
    assert node._topic == '/image'
    names = '-r image:=/left/image or -r image:=/right/image'
    assert names in node._advice()
    said = f'image: 2 topics could be meant; to use one: {names}\n'
    text = ''

    def is_said():
        nonlocal text
        text += ''.join(capfd.readouterr())
        return said in text

    client.wait_for(is_said)


def test_the_default_image_topic_is_preferred(client, vpr, map_path):
    offered(client, (Image, '/other/image_raw'), (Image, '/image'))
    node = vpr(map_path=map_path)
    client.wait_for(lambda: node.count_publishers('/other/image_raw') and node._finder._last)
    assert node._topic == '/image'
    client.wait_for(lambda: used(node)[0] == '/image')


def test_a_camera_that_recognised_a_place_is_kept(client, vpr, street, image, map_path):
    (lidar,) = offered(client, (Image, '/lidar/nearir_image'))
    node = vpr(map_path=map_path, fixed_length=1)
    client.wait_for(lidar.get_subscription_count)
    client.wait_until_known_to('/vpr_node')
    for number, gray in enumerate(street[:6], 1):
        lidar.publish(image(gray, number * SECOND))
    client.wait_for(lambda: node._finder.is_settled)
    offered(client, (Image, '/camera/image_raw'))
    client.wait_for(lambda: node.count_publishers('/camera/image_raw'))
    client.wait_for(node._finder._timer.is_canceled)
    assert node._topic == '/lidar/nearir_image'


DRIVERS = {
    'lidar 2': [(Image, '/robot2/lidar/nearir_image')],
    'camera 2': [(Image, '/robot2/camera/image_raw'), (Odometry, '/robot2/wheels/odom')],
    'camera 1': [(Image, '/robot1/camera/image_raw'), (Odometry, '/robot1/wheels/odom')],
}
OWN = {
    name: (f'{name}/camera/image_raw', f'{name}/camera_info', f'{name}/wheels/odom')
    for name in ('/robot1', '/robot2')
}


@pytest.mark.parametrize(
    'order',
    [
        ('nodes', 'camera 2', 'camera 1', 'lidar 2'),
        ('lidar 2', 'nodes', 'camera 2', 'camera 1'),
        ('camera 1', 'lidar 2', 'camera 2', 'nodes'),
    ],
)
def test_each_robot_takes_its_own_camera_and_odometry(client, vpr, order):
    """All orders of start are in test_topic_finder.py."""
    nodes, running = {}, set()

    def holds():
        images = {name: used(node)[0] for name, node in nodes.items()}
        if 'lidar 2' in running and 'camera 2' not in running:
            return images['/robot2'] == '/robot2/lidar/nearir_image'
        wanted = {f'/robot{it[-1]}' for it in running if it.startswith('camera')}
        return all(used(nodes[name]) == OWN[name] for name in wanted)

    for started in order:
        running.add(started)
        if started == 'nodes':
            nodes |= {name: vpr('-r', f'__ns:={name}') for name in OWN}
        else:
            offered(client, *DRIVERS[started])
        if nodes:
            client.wait_for(holds)
        if nodes and 'camera 2' in running and 'camera 1' not in running:
            other, finder = nodes['/robot1'], nodes['/robot1']._finder
            client.wait_for(lambda other=other: other.count_publishers('/robot2/wheels/odom'))
            assert finder._find(offers_of(other)) == {'image': []}
            assert finder.cameras() == ['/robot2/camera/image_raw']  # that a person may choose


def test_places_added_from_an_abandoned_topic_leave_the_map(
    client, vpr, street, image, map_path, tmp_path, capfd
):
    path = tmp_path / 'growing.db'
    path.write_bytes(map_path.read_bytes())
    (lidar,) = offered(client, (Image, '/lidar/nearir_image'))
    node = vpr(map_path=path, mode='online', keyframe_overlap=1.0)
    client.wait_for(lidar.get_subscription_count)
    client.wait_until_known_to('/vpr_node')
    noise = np.random.default_rng(5).integers(0, 256, (8, *street[0].shape), np.uint8)

    def show(camera, pictures):
        for gray in pictures:
            count = node._counters.processed + 1
            camera.publish(image(gray, (LATER_S + count) * SECOND))
            client.wait_for(lambda count=count: node._counters.processed == count)

    show(lidar, noise[:3])
    client.wait_for(lambda: node._recognition.pipeline.autosave.committed == len(street) + 3)
    (camera,) = offered(client, (Image, '/camera/image_raw'))
    client.wait_for(camera.get_subscription_count)
    client.wait_for(lambda: node._recognition.pipeline.added == 0)
    assert len(open_map(path)) == len(street)
    client.wait_until_known_to('/vpr_node')
    show(camera, noise[3:])
    node.context.try_shutdown()
    client.wait_for(lambda: len(open_map(path)) == len(street) + 5, 'the file to be complete')
    assert [place.source for place in open_map(path).places[25:]] == 5 * ['/camera/image_raw']
    assert (
        'found image on /camera/image_raw instead of /lidar/nearir_image; to choose another, '
        '-r NAME:=TOPIC; 3 places are taken out of the map again\n'
    ) in capfd.readouterr().err
