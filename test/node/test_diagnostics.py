# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The state on /diagnostics names what is wrong and what to do."""

from itertools import count

from convseq_ros.config import KeyframeConfig
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.writer import save_map
from convseq_ros.node.inputs import following_subscription
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
import pytest
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_srvs.srv import SetBool

SECOND = 1_000_000_000
PERIOD = {'diagnostics_period_s': 0.1}


@pytest.fixture
def impatient(monkeypatch):
    """Have the node miss images sooner."""
    monkeypatch.setattr(following_subscription, '_SILENCE_S', 0.2)


def moved(sec, nanosec=0, x=0.0):
    message = Odometry()
    message.header.stamp.sec, message.header.stamp.nanosec = sec, nanosec
    message.pose.pose.position.x, message.pose.pose.orientation.w = x, 1.0
    return message


def status_with(client, text):
    heard = client.listen(DiagnosticArray, '/diagnostics')
    client.wait_for(lambda: heard and text in heard[-1].status[0].message, text)
    return heard[-1].status[0]


CARRIES = 'carries geometry_msgs/msg/PoseStamped, not nav_msgs/msg/Odometry'
FIRST = 'no images for'
# What has a publisher, where the node looks for images, and what it says; each once in the log.
MISSING = [
    ({'/odom': PoseStamped}, '/image', 'no odometry:', f'/odom {CARRIES}; remap it: -r odom:='),
    ({'/image': Image}, '/front', FIRST, '/front has no publisher; images are on /image; to take'),
    ({'/image': Image}, '/image', FIRST, '/image has 1 publisher(s), but none sends'),
    ({'/cam/compressed': CompressedImage}, '/cam', FIRST, '-r image:=/cam/compressed'),
    ({'/cam': Image}, '/cam/compressed', FIRST, 'to take the first: -r image:=/cam'),
    ({'/cam': DiagnosticArray}, '/cam', FIRST, 'remap `image` to a topic of sensor_msgs/msg/Im'),
]


@pytest.mark.parametrize(('given', 'topic', 'first', 'told'), MISSING)
def test_what_is_missing_is_a_warning_with_the_remedy_that_is_logged_once(
    client, vpr, map_path, impatient, capfd, given, topic, first, told
):
    for name, kind in given.items():
        client.node.create_publisher(kind, name, 1)
    vpr('-r', f'image:={topic}', map_path=map_path, **PERIOD)
    status = status_with(client, told)
    assert status.level == DiagnosticStatus.WARN and first in status.message
    log = []

    def logged():
        log.append(capfd.readouterr().err)
        return ''.join(log).count(first)

    client.wait_for(logged)  # once, whatever it says was missing at first
    heard = client.listen(DiagnosticArray, '/diagnostics')
    client.wait_for(lambda: len(heard) >= 5 and first in heard[-1].status[0].message)
    assert logged() == 1


def test_without_a_map_or_its_file_there_is_an_error(client, vpr, tmp_path):
    vpr(**PERIOD)
    status = status_with(client, '/vpr_node/load_map')
    assert status.level == DiagnosticStatus.ERROR
    assert status.name == 'vpr_node: place recognition'
    node = vpr('-r', '__ns:=/b', map_path=tmp_path / 'map.db', mode='online', **PERIOD)
    client.wait_for(lambda: node._ready)
    node._recognition.pipeline.owner.give_up('map.db: damaged map')
    assert status_with(client, 'map.db: damaged map').level == DiagnosticStatus.ERROR


def test_a_node_that_receives_images_is_ok(client, vpr, map_path, street, image):
    vpr(map_path=map_path, **PERIOD)
    client.camera(Image).publish(image(street[0], SECOND))
    status = status_with(client, 'recognising places')
    assert status.level == DiagnosticStatus.OK
    keys = {item.key for item in status.values}
    assert {'received_hz', 'processed_hz', 'queue', 'dropped', 'latency_ms', 'last_reason'} <= keys


def test_keyframes_by_odometry_without_odometry_are_a_warning(
    client, vpr, street, image, tmp_path
):
    path = tmp_path / 'spaced.db'
    save_map(ReferenceMap(keyframes=KeyframeConfig(keyframe_distance_m=1.5)), path)
    vpr(map_path=path, mode='online', keyframe_distance_m=1.5, **PERIOD)
    camera = client.camera(Image)
    status = status_with(client, 'a place every 1.5 m, but there is no odometry')
    assert status.level == DiagnosticStatus.WARN
    odometry = client.node.create_publisher(Odometry, '/odom', 1)

    def told():
        odometry.publish(moved(1))
        camera.publish(image(street[0], SECOND))
        return len(heard) and heard[-1].status[0].level == DiagnosticStatus.OK

    heard = client.listen(DiagnosticArray, '/diagnostics')
    client.wait_for(told)


def test_odometry_that_stops_is_a_warning(client, vpr, map_path, street, image, impatient, capfd):
    vpr(map_path=map_path, **PERIOD)
    camera = client.camera(Image)
    client.camera(Odometry, '/odom').publish(moved(1))
    heard = client.listen(DiagnosticArray, '/diagnostics')

    def told():
        camera.publish(image(street[0], SECOND))
        return heard and 'odometry stopped: nothing on /odom for' in heard[-1].status[0].message

    client.wait_for(told)
    status = heard[-1].status[0]
    assert status.level == DiagnosticStatus.WARN
    assert {pair.key: pair.value for pair in status.values}['odom'] == 'False'
    assert capfd.readouterr().err.count('odometry stopped') == 1


def test_a_node_with_the_same_name_is_a_warning(client, vpr, map_path):
    for told in ('recognising places', 'another node is named /vpr_node'):
        vpr(map_path=map_path, **PERIOD)
        status = status_with(client, told)
    assert status.level == DiagnosticStatus.WARN


def test_a_disabled_node_does_not_warn_of_missing_images(client, vpr, map_path, impatient):
    vpr(map_path=map_path, **PERIOD)
    client.call(SetBool, '/vpr_node/set_enabled', data=False)
    assert status_with(client, 'disabled').level == DiagnosticStatus.OK


def test_without_a_camera_the_topics_with_images_are_named_ready_to_paste(
    client, vpr, map_path, impatient, capfd
):
    for kind, topic in (
        (Image, '/camera/depth/image_rect_raw'),
        (Image, '/camera/color/image_raw'),
        (CompressedImage, '/camera/color/image_raw/compressed'),
        (CameraInfo, '/camera/color/camera_info'),
        (Image, '/robot1/lidar/nearir_image'),
        (Image, '/robot1/vpr_node2/debug_image'),
    ):
        client.node.create_publisher(kind, topic, 1)
    client.node.create_subscription(Image, '/nobody/sends', print, 1)
    told = {
        '/': '/camera/color/image_raw, /camera/color/image_raw/compressed, '
        '/robot1/lidar/nearir_image, /camera/depth/image_rect_raw; to take the first: '
        '-r image:=/camera/color/image_raw -r camera_info:=/camera/color/camera_info',
        '/robot1': '/robot1/lidar/nearir_image, /camera/color/image_raw, '
        '/camera/color/image_raw/compressed, /camera/depth/image_rect_raw; to take the first: '
        '-r image:=/robot1/lidar/nearir_image',
    }
    nodes = [vpr('-r', f'__ns:={name}', map_path=map_path, **PERIOD) for name in told]
    for node, line in zip(nodes, told.values(), strict=True):
        status = status_with(client, f'{node._topic} has no publisher; images are on {line}')
        assert status.level == DiagnosticStatus.WARN
        assert node._advice().endswith(line)
    assert capfd.readouterr().err.count('images are on') == 2


def test_a_camera_that_never_comes_is_a_warning_beside_one_that_does(
    client, vpr, map_path, impatient, street, image, capfd
):
    vpr(map_path=map_path, image_topics='/front /rear', **PERIOD)
    camera = client.camera(Image, '/front')
    heard = client.listen(DiagnosticArray, '/diagnostics')
    stamps = count(1)

    def told():
        camera.publish(image(street[0], next(stamps) * SECOND))
        text = heard[-1].status[0].message if heard else ''
        wanted = 'no images for', '/rear has no publisher; look'
        return all(one in text for one in wanted) and '/front' not in text

    client.wait_for(told)
    assert capfd.readouterr().err.count('/rear has no publisher') == 1


def test_a_camera_is_reported_once_each_time_that_it_stops(
    client, vpr, map_path, impatient, street, image, capfd
):
    vpr(map_path=map_path, **PERIOD)
    camera = client.camera(Image)
    heard = client.listen(DiagnosticArray, '/diagnostics')
    for stamp_s in (1, 2):
        camera.publish(image(street[0], stamp_s * SECOND))
        client.wait_for(lambda: heard[-1].status[0].level == DiagnosticStatus.OK)
        heard.clear()
        client.wait_for(lambda: len(heard) >= 5 and 'stopped' in heard[-1].status[0].message)
    status = heard[-1].status[0]
    assert status.message.startswith('the camera stopped: no images on /image for')
    assert status.hardware_id == '/image'
    assert capfd.readouterr().err.count('the camera stopped') == 2


def test_constant_or_whole_second_stamps_are_a_warning(
    client, vpr, map_path, street, image, capfd
):
    node = vpr(map_path=map_path, **PERIOD)
    odometry, camera = client.camera(Odometry, '/odom'), client.camera(Image)
    metres = count(0.2, 0.2)

    def state_with(stamps_ns, told):
        for stamp_ns in stamps_ns:
            odometry.publish(moved(*divmod(stamp_ns, SECOND), next(metres)))
            camera.publish(image(street[0], stamp_ns))
        return status_with(client, told)

    taken_ns = [9 * SECOND + number * SECOND // 5 for number in range(20)]
    constant = state_with([9 * SECOND + 5] * 20, '/image: 20 images in a row have one stamp')
    whole = state_with(
        [it // SECOND * SECOND for it in taken_ns], 'have 4 stamps of whole seconds'
    )
    assert (constant.level, whole.level) == (DiagnosticStatus.WARN, DiagnosticStatus.WARN)
    assert whole.message.endswith('have the driver stamp each image when it is taken')
    right = state_with([it + 10 * SECOND for it in taken_ns], 'recognising places')
    assert right.level == DiagnosticStatus.OK
    client.wait_for(lambda: node._counters.received == 60)
    assert capfd.readouterr().err.count('one stamp') == 1
