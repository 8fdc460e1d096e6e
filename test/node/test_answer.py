# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""~/answer says all of a frame in one message, ~/map_info which map answers."""

from convseq_ros.core.map.reader import open_map
from convseq_ros.node.conversions import stamp_to_ns
from convseq_ros.results import COLUMNS, read_results
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import Image

SECOND = 1_000_000_000
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def test_every_frame_has_an_answer_that_is_its_row(client, vpr, street, image, map_path, tmp_path):
    table = tmp_path / 'live.csv'
    node = vpr(map_path=map_path, result_file=table)
    answers = client.listen(DiagnosticArray, '/vpr_node/answer')
    camera = client.camera(Image)
    for index in range(8):
        camera.publish(image(street[index], index * SECOND + 7))
    client.wait_for(lambda: len(answers) == 8)
    node.context.try_shutdown()
    client.wait_for(table.exists)
    rows = read_results(table)
    reference_map = open_map(map_path)
    assert [stamp_to_ns(one.header.stamp) for one in answers] == [
        index * SECOND + 7 for index in range(8)
    ]
    for message, row in zip(answers, rows, strict=True):
        found = client.values_of(message)
        assert {name: found[name] for name in COLUMNS} == row
        assert message.status[0].message == row['reason']
        assert found['map_id'] == reference_map.map_id
        assert not row['best_index'] or found['session_id'] == reference_map.sessions[0].id
    anchors = {row['anchor_session'] for row in rows if row['reason'] == 'accepted'}
    assert anchors == {reference_map.sessions[0].id}


def test_the_map_is_told_to_whoever_comes_late(client, vpr, map_path):
    node = vpr(map_path=map_path)
    client.wait_for(lambda: node._ready)
    told = client.listen(DiagnosticArray, '/vpr_node/map_info', LATCHED)
    client.wait_for(lambda: told)
    message = told[0]
    found = client.values_of(message)
    assert found['map_id'] == open_map(map_path).map_id
    assert (found['places'], found['with_pose'], found['sessions']) == ('25', '25', '1')
    assert message.status[0].message == '25 places, 25 with a pose'


def test_numbers_of_queries_count_frames_that_were_dropped(
    client, vpr, street, image, map_path, held, tmp_path
):
    node = vpr(map_path=map_path, queue_size=2)
    answers = client.listen(DiagnosticArray, '/vpr_node/answer')
    camera = client.camera(Image)
    for index in range(8):
        camera.publish(image(street[index], index * SECOND + 1))
        client.wait_for(lambda index=index: node._statistics.received == index + 1)
    client.wait_for(lambda: node._worker.dropped == 5)
    held.set()
    client.wait_for(lambda: len(answers) == 3)
    assert [client.values_of(one)['query_index'] for one in answers] == ['0', '6', '7']
    assert [stamp_to_ns(one.header.stamp) // SECOND for one in answers] == [0, 6, 7]
