# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Services and dynamic parameters act between two frames; no frame is lost by them."""

import os
import shutil
from unittest.mock import Mock

from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.writer import save_map
from convseq_ros.node import vpr_node
from convseq_ros.node.services import map_services
from nav_msgs.srv import LoadMap
import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from sensor_msgs.msg import Image
from std_msgs.msg import UInt32
from std_srvs.srv import SetBool, Trigger

SECOND = 1_000_000_000


def set_parameter(client, name, value):
    parameter = Parameter(name, value=value).to_parameter_msg()
    answer = client.call(SetParameters, '/vpr_node/set_parameters', parameters=[parameter])
    return answer.results[0]


@pytest.mark.parametrize(
    ('is_given', 'told'),
    [
        (False, 'no map yet: map_path is empty, and sections of a parameter file are read if they '
         'name /vpr_node or /**; waiting for ~/load_map'),
        (True, 'empty.db has no places; add a drive: convseq build-map'),
    ],
)  # fmt: skip
def test_a_node_without_places_says_what_it_lacks(client, vpr, tmp_path, capfd, is_given, told):
    save_map(ReferenceMap(), path := tmp_path / 'empty.db')
    node = vpr(**({'map_path': path} if is_given else {}))
    client.wait_for(lambda: node._listening)
    client.call(Trigger, '/vpr_node/reset')  # the node has logged by then
    assert told in capfd.readouterr().err


def test_without_a_map_the_node_waits_for_one(client, vpr, show, map_path, tmp_path):
    node = vpr(fixed_length=1, save_map_path=tmp_path / 'copy.db')
    assert show(3) == -1
    answer = client.call(Trigger, '/vpr_node/save_map')
    assert not answer.success
    assert answer.message == 'there is no map to save; load one with ~/load_map'
    named = tmp_path / 'my map.db'
    named.write_bytes(map_path.read_bytes())
    url = f'file://{tmp_path}/my%20map.db'
    answer = client.call(LoadMap, '/vpr_node/load_map', map_url=url)
    assert answer.result == LoadMap.Response.RESULT_SUCCESS
    assert show(3) == 3
    client.wait_for(lambda: node._counters.reasons == {'no_map': 1, 'accepted': 1})


def test_a_map_that_cannot_be_loaded_leaves_the_old_one(
    client, vpr, show, map_path, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'foreign.db').write_text('something else')
    vpr(map_path=map_path, fixed_length=1)
    absent = LoadMap.Response.RESULT_MAP_DOES_NOT_EXIST
    invalid = LoadMap.Response.RESULT_INVALID_MAP_DATA
    for url, result in (
        ('missing.db', absent), ('', absent), ('foreign.db', invalid), ('long' * 1000, absent),
    ):  # fmt: skip
        assert client.call(LoadMap, '/vpr_node/load_map', map_url=url).result == result, url
    assert show(3) == 3


def test_save_map_path_decides_where_a_map_is_saved(client, vpr, street_map, map_path, tmp_path):
    vpr(map_path=map_path)
    answer = client.call(Trigger, '/vpr_node/save_map')
    assert (answer.success, answer.message.split(';')[0]) == (False, 'save_map_path is empty')
    path = tmp_path / 'copy.db'
    assert set_parameter(client, 'save_map_path', str(path)).successful
    answer = client.call(Trigger, '/vpr_node/save_map')
    assert (answer.success, answer.message) == (True, str(path))
    assert list(open_map(path, street_map.encoding).places) == list(street_map.places)


def test_a_growing_map_whose_file_is_gone_is_saved_elsewhere_or_left(
    client, vpr, map_path, tmp_path
):
    gone, copy = (shutil.copy(map_path, tmp_path / name) for name in ('gone.db', 'copy.db'))
    vpr(map_path=gone, mode='online', keyframe_overlap=1, save_map_path=copy)
    gone.unlink()
    assert client.call(Trigger, '/vpr_node/save_map').success
    answer = client.call(LoadMap, '/vpr_node/load_map', map_url=str(copy))
    assert answer.result == LoadMap.Response.RESULT_SUCCESS


UNSAVED = {
    'notes.txt': 'is no map, and is not replaced',
    'locked/copy.db': 'is read-only',
    'other.db': 'is another map, and is not replaced',
    'result.csv': 'is read or written by the same',
}


def test_a_map_that_cannot_be_saved_is_reported_in_one_line(
    client, vpr, show, map_path, tmp_path, monkeypatch
):
    (tmp_path / 'notes.txt').write_text('precious')
    (tmp_path / 'locked').mkdir()
    # As it answers to whoever is not root.
    monkeypatch.setattr(os, 'access', lambda path, _: path.name != 'locked')
    save_map(ReferenceMap(), tmp_path / 'other.db')
    vpr(map_path=map_path, result_file=tmp_path / 'result.csv', fixed_length=1)
    for name, told in UNSAVED.items():
        assert set_parameter(client, 'save_map_path', str(tmp_path / name)).successful
        answer = client.call(Trigger, '/vpr_node/save_map')
        assert not answer.success and '\n' not in answer.message
        assert name in answer.message and told in answer.message
    assert not len(open_map(tmp_path / 'other.db'))
    assert (tmp_path / 'notes.txt').read_text() == 'precious'
    assert show(3) == 3


def test_an_unexpected_error_fails_the_service_but_not_the_node(
    client, vpr, show, map_path, tmp_path, monkeypatch, capfd
):
    vpr(map_path=map_path, save_map_path=tmp_path / 'copy.db', fixed_length=1)
    fail = Mock(side_effect=ValueError('a surprise'))
    monkeypatch.setattr(map_services, 'save_map', fail)
    monkeypatch.setattr(vpr_node, 'Pipeline', fail)
    assert client.call(Trigger, '/vpr_node/save_map').message == 'a surprise'
    answer = client.call(LoadMap, '/vpr_node/load_map', map_url=str(map_path))
    assert answer.result == LoadMap.Response.RESULT_INVALID_MAP_DATA
    assert show(3) == 3
    assert capfd.readouterr().err.count('ValueError: a surprise') == 2


def test_reset_and_a_pause_start_the_sequence_anew(client, vpr, show, map_path, street, image):
    node = vpr(map_path=map_path)
    assert [show(place) for place in (1, 2, 3)] == [-1, 2, 3]
    assert client.call(Trigger, '/vpr_node/reset').success
    assert [show(place) for place in (4, 5)] == [-1, 5]
    assert client.call(SetBool, '/vpr_node/set_enabled', data=False).message == 'disabled'
    client.camera(Image).publish(image(street[3], 50 * SECOND))
    client.wait_for(lambda: node._counters.received == 6)
    assert client.call(SetBool, '/vpr_node/set_enabled', data=True).message == 'enabled'
    assert [show(place) for place in (6, 7)] == [-1, 7]
    client.wait_for(lambda: node._counters.processed == 7)


def test_a_dynamic_parameter_takes_effect_with_the_next_frame(client, vpr, show, map_path):
    vpr(map_path=map_path, fixed_length=1)
    lengths = client.listen(UInt32, '/vpr_node/sequence_length')
    assert show(1) == 1
    assert set_parameter(client, 'fixed_length', 2).successful
    assert show(2) == 2
    assert set_parameter(client, 'min_margin', 1).successful
    assert show(3) == -1
    client.wait_for(lambda: len(lengths) == 3)
    assert [message.data for message in lengths] == [1, 2, 2]


def test_a_changed_parameter_reaches_the_part_that_uses_it(client, vpr, map_path, tmp_path, capfd):
    node = vpr(map_path=map_path)
    client.wait_for(lambda: node._ready)
    assert not node.count_publishers('/initialpose')
    changes = {
        'queue_size': 3, 'max_wait_s': 2.5, 'odom_wait_s': 0.25, 'diagnostics_period_s': 0.5,
        'publish_initial_pose': True, 'stationary_m': 0.5, 'camera_to_base': '1 0 0 0 0 0',
        'max_image_mpx': 2.0, 'max_file_mb': 8.0,
    }  # fmt: skip
    for name, value in changes.items():
        assert set_parameter(client, name, value).successful
    client.wait_for(lambda: node.count_publishers('/initialpose'))
    recognizer = node._recognition.pipeline.recognizer
    client.wait_for(lambda: recognizer.config.reading.max_file_mb == 8.0)
    worker, context = node._worker, node._frame_context
    assert (worker._size, worker._max_wait_ns) == (3, 2_500_000_000)
    assert context.odometry.wait_s == 0.25
    assert node._diagnostics._timer.timer_period_ns == 500_000_000
    assert recognizer.gate._standstill._config.stationary_m == 0.5
    assert recognizer.config.robot.mount == (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert recognizer.config.reading.max_image_mpx == 2.0
    told = capfd.readouterr().err
    assert 'queue_size is now 3; it was 30' in told
    assert told.count(' is now ') == len(changes)


def test_services_answer_while_a_frame_is_processed(client, vpr, street, image, map_path, held):
    node = vpr(map_path=map_path, queue_size=1000)
    camera = client.camera(Image)
    for index in range(20):
        camera.publish(image(street[index], (index + 1) * SECOND))
    client.wait_for(lambda: node._worker.waiting == 19)
    assert client.call(Trigger, '/vpr_node/reset').success
    assert node._worker.waiting == 19
    held.set()
    client.wait_for(lambda: node._counters.processed == 20)
