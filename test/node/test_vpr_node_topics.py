# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Images go in, the places of the map come out, on each topic and in one message."""

import signal

from convseq_ros.app.result_row import COLUMNS
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.writer import save_map
from convseq_ros.io.results import read_results
from convseq_ros.node.conversions import CANDIDATE, stamp_to_ns
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Path
import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import Float32, Float64MultiArray, Int32, Int64MultiArray, UInt32

SECOND = 1_000_000_000
LATER_NS = 1000 * SECOND
NUM_FRAMES = 20
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
KINDS = {
    'match_index': Int32,
    'match_score': Float32,
    'confidence': Float32,
    'latency_ms': Float32,
    'sequence_length': UInt32,
    'candidates': PointCloud2,
    'loop_closure': Float64MultiArray,
    'loop_closure_index': Int64MultiArray,
    'pose': PoseWithCovarianceStamped,
}


def test_a_second_drive_is_recognised_on_all_topics(
    client, start, map_path, street, image, tmp_path
):
    result_file = tmp_path / 'result.csv'
    told = open_map(map_path)
    told.position_sigma_m = 3.0
    save_map(told, tmp_path / 'told.db')
    given = {'map_path': tmp_path / 'told.db', 'result_file': result_file}
    process = start('vpr_node', position_sigma_m=2, **given)
    heard = {name: client.listen(kind, f'/vpr_node/{name}') for name, kind in KINDS.items()}
    camera = client.camera(Image)
    for index in range(NUM_FRAMES):
        camera.publish(image(street[index], LATER_NS + index * SECOND))
    client.wait_for(lambda: len(heard['candidates']) == NUM_FRAMES, 'an answer to every frame')
    client.wait_for(lambda: heard['pose'] and heard['pose'][-1].pose.pose.position.x == 19)

    indices = [message.data for message in heard['match_index']]
    assert indices[0] == -1
    assert indices[1:] == list(range(1, NUM_FRAMES))
    lengths = [message.data for message in heard['sequence_length']]
    scores = [message.data for message in heard['match_score']]
    assert lengths[0] == 0
    assert scores[0] == 0.0
    assert all(2 <= length <= 25 for length in lengths[1:])
    assert all(0.5 < score <= 1.0 for score in scores[1:])
    assert all(message.data > 0.0 for message in heard['latency_ms'])
    assert len(heard['latency_ms']) == NUM_FRAMES
    assert {message.data for message in heard['confidence']} == {0.0}  # these settings know none

    for number, message in enumerate(heard['candidates']):
        assert stamp_to_ns(message.header.stamp) == LATER_NS + number * SECOND
        assert message.header.frame_id == 'map'
    rows = np.frombuffer(bytes(heard['candidates'][9].data), CANDIDATE)
    assert rows['index'][0] == 9
    assert rows['score'][0] == pytest.approx(scores[9])
    assert rows['length'][0] == lengths[9]
    assert (rows['x'][0], rows['y'][0], rows['z'][0]) == (9.0, 2.0, 0.5)
    assert (rows['stamp_sec'][0], rows['stamp_nanosec'][0]) == (9, 1)
    assert len(np.frombuffer(bytes(heard['candidates'][0].data), CANDIDATE)) == 0

    closures = [message.data.tolist() for message in heard['loop_closure']]
    assert closures == [pytest.approx([1000 + i, i], abs=1e-6) for i in range(1, NUM_FRAMES)]
    pairs = [message.data.tolist() for message in heard['loop_closure_index']]
    assert pairs == [[i, i] for i in range(1, NUM_FRAMES)]
    pose = heard['pose'][8]
    assert pose.header == heard['candidates'][9].header
    assert pose.pose.pose.position.x == 9.0
    assert pose.pose.pose.orientation.w == 0.8
    # Places lie a metre apart along x.
    covariance = pose.pose.covariance.reshape(6, 6)
    assert covariance[0, 0] == pytest.approx(3.0**2 + 1 / 12)
    assert covariance[1, 1] == covariance[2, 2] == 3.0**2

    process.send_signal(signal.SIGINT)
    assert process.wait(60) == 0
    table = read_results(result_file)
    assert [int(row['query_stamp_ns']) for row in table] == [
        LATER_NS + index * SECOND for index in range(NUM_FRAMES)
    ]
    assert [int(row['reference_index'] or -1) for row in table] == indices


def test_the_debug_image_is_published_to_subscribers(client, vpr, map_path, street, image):
    vpr(map_path=map_path, fixed_length=1)
    indices = client.listen(Int32, '/vpr_node/match_index')
    camera = client.camera(Image)
    camera.publish(image(street[3], LATER_NS))
    client.wait_for(lambda: indices)
    pictures = client.listen(Image, '/vpr_node/debug_image')
    client.wait_until_known_to('/vpr_node')
    camera.publish(image(street[4], LATER_NS + SECOND))
    # A slow node may draw the first frame, too: its index is told before its picture is made.
    of = {LATER_NS, LATER_NS + SECOND}
    client.wait_for(lambda: pictures and stamp_to_ns(pictures[-1].header.stamp) == max(of))
    assert {stamp_to_ns(one.header.stamp) for one in pictures} <= of
    assert (pictures[-1].encoding, pictures[-1].height) == ('bgr8', 264)
    assert pictures[-1].header.frame_id == 'camera'
    assert np.frombuffer(pictures[-1].data, np.uint8).std() > 10


def test_every_frame_has_an_answer_that_is_its_row(client, vpr, show, map_path, tmp_path):
    table = tmp_path / 'live.csv'
    node = vpr(map_path=map_path, result_file=table)
    answers = client.listen(DiagnosticArray, '/vpr_node/answer')
    show(*range(8))
    client.wait_for(lambda: len(answers) == 8)
    node.context.try_shutdown()
    client.wait_for(table.exists)
    rows = read_results(table)
    reference_map = open_map(map_path)
    stamps_ns = [stamp_to_ns(one.header.stamp) for one in answers]
    assert stamps_ns == [index * SECOND for index in range(1, 9)]
    for message, row in zip(answers, rows, strict=True):
        found = client.values_of(message)
        assert {name: found[name] for name in COLUMNS} == row
        assert message.status[0].message == row['reason']
        assert message.header.frame_id == 'map'
        assert found['map_id'] == message.status[0].hardware_id == reference_map.map_id
        assert not row['best_index'] or found['session_id'] == reference_map.sessions[0].id
    anchors = {row['anchor_session'] for row in rows if row['reason'] == 'accepted'}
    assert anchors == {reference_map.sessions[0].id}


def test_a_late_subscriber_gets_the_path_and_the_map_info(client, vpr, map_path):
    node = vpr(map_path=map_path)
    client.wait_for(lambda: node._ready)
    told = client.listen(DiagnosticArray, '/vpr_node/map_info', LATCHED)
    paths = client.listen(Path, '/vpr_node/reference_path', LATCHED)
    client.wait_for(lambda: told and paths, 'what was published at the start')
    found, message = client.values_of(told[0]), told[0]
    assert found['map_id'] == message.status[0].hardware_id == open_map(map_path).map_id
    assert message.header.frame_id == 'map'
    assert (found['places'], found['with_pose'], found['sessions']) == ('25', '25', '1')
    assert message.status[0].message == '25 places, 25 with a pose'
    assert [each.pose.position.x for each in paths[0].poses] == list(range(25))
    assert {each.header.frame_id for each in (paths[0], *paths[0].poses)} == {'map'}
