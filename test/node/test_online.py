# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""In online mode the map grows from the node's own past, and is kept as it grows."""

import threading
from unittest.mock import Mock

from convseq_ros.app.pipeline import Pipeline
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.writer import save_map
from convseq_ros.errors import ConfigError
from convseq_ros.node.conversions import CANDIDATE
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from nav_msgs.srv import LoadMap
import numpy as np
from pictures import walls
import pytest
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import Float64MultiArray, Int32, Int64MultiArray
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker, MarkerArray

SECOND = 1_000_000_000
LATER_S = 1000
# With every frame, as in the map of the street.
ONLINE = {
    'mode': 'online', 'fixed_length': 1, 'rival_distance': 2,
    'keyframe_overlap': 1.0,
}  # fmt: skip


def drive(camera, street, image, places, begin_s=LATER_S):
    for number, place in enumerate(places):
        camera.publish(image(street[place], (begin_s + number) * SECOND))


def test_the_second_round_closes_loops_after_30_s_and_the_map_is_saved(
    client, vpr, street, image, tmp_path
):
    path = tmp_path / 'new.db'
    node = vpr(map_path=path, diagnostics_period_s=0.1, **ONLINE)
    closures = client.listen(Float64MultiArray, '/vpr_node/loop_closure')
    indices = client.listen(Int32, '/vpr_node/match_index')
    diagnostics = client.listen(DiagnosticArray, '/diagnostics')
    camera = client.camera(Image)
    shown = 0
    for after_s, places in (0, range(15)), (15, [*range(15, 25), *range(5)]), (35, range(5, 10)):
        drive(camera, street, image, places, LATER_S + after_s)
        shown += len(places)
        client.wait_for(lambda: len(indices) == shown, 'an answer to every frame')  # noqa: B023
    assert [message.data for message in indices] == [-1] * 25 + list(range(10))
    client.wait_for(lambda: len(closures) == 5)  # the others are of 25 s before
    assert [message.data.tolist() for message in closures] == [
        [LATER_S + 30 + index, LATER_S + index] for index in range(5, 10)
    ]
    client.wait_for(lambda: client.values_of(diagnostics[-1])['processed'] == '35')
    values = client.values_of(diagnostics[-1])
    assert (values['mode'], values['state'], values['kernel']) == ('online', 'enabled', 'numpy')
    assert (values['places_added'], values['map_size']) == ('35', '35')
    assert values['reason_recent'] == '21' and values['reason_accepted'] == '10'
    # The node of the test before may be seen for a moment: they have one name.
    own = 'recognising places and adding to them'
    client.wait_for(lambda: own in [message.status[0].message for message in diagnostics])
    node.context.try_shutdown()
    client.wait_for(lambda: len(open_map(path)) == 35, 'the file to be complete')


def test_a_late_subscriber_gets_all_closures_and_then_the_new_ones(client, vpr, image, tmp_path):
    node, shown = vpr(map_path=tmp_path / 'new.db', odom_wait_s=5.0, **ONLINE), []
    street = walls(33)
    odom, camera = client.camera(Odometry, '/odom'), client.camera(Image)

    def show(*places):
        for place in places:
            message, stamp_s = Odometry(), LATER_S + len(shown)
            message.header.stamp.sec, message.pose.pose.position.x = stamp_s, float(place)
            message.pose.pose.orientation.w = 1.0
            odom.publish(message)
            camera.publish(image(street[place], stamp_s * SECOND))
            shown.append(place)
        client.wait_for(lambda: node._counters.processed == len(shown))

    def drawn_at(drawn, place):
        drawn.clear()
        show(place)
        client.wait_for(lambda: drawn)
        return {marker.ns: marker for marker in drawn[0].markers}

    for places in (range(15), range(15, 25), range(10)):
        show(*places)
    drawn = client.listen(MarkerArray, '/vpr_node/markers')
    client.wait_until_known_to('/vpr_node')
    everything = drawn_at(drawn, 30)
    assert everything.keys() == {'match', 'loop_nodes', 'loop_edges', 'places'}
    edges = [(point.x, point.y) for point in everything['loop_edges'].points]
    assert edges == [(float(place), 0.0) for place in range(10) for _ in range(2)]
    assert len(everything['places'].points) >= 20
    assert everything['match'].action == Marker.DELETE
    assert drawn_at(drawn, 31).keys() == {'match'}
    assert drawn_at(drawn, 11).keys() == {'match', 'loop_nodes', 'loop_edges'}
    client.listen(MarkerArray, '/vpr_node/markers')
    client.wait_until_known_to('/vpr_node')
    assert drawn_at(drawn, 32).keys() == everything.keys()


def test_the_places_of_yesterday_are_recognised_but_close_no_loop_of_today(
    client, vpr, street, street_map, image, tmp_path
):
    path = tmp_path / 'days.db'
    save_map(street_map, path)
    node = vpr(map_path=path, **ONLINE)
    closures = client.listen(Float64MultiArray, '/vpr_node/loop_closure')
    pairs = client.listen(Int64MultiArray, '/vpr_node/loop_closure_index')
    poses = client.listen(PoseWithCovarianceStamped, '/vpr_node/pose')
    clouds = client.listen(PointCloud2, '/vpr_node/candidates')
    drive(client.camera(Image), street, image, [20, 21, 22, 23, 24])
    client.wait_for(lambda: len(clouds) == 5)
    client.wait_for(lambda: len(poses) == 5)
    rows = [np.frombuffer(bytes(cloud.data), CANDIDATE) for cloud in clouds]
    assert [row['index'][0] for row in rows] == [*range(20, 25)]
    assert [message.data.tolist() for message in pairs] == [[i, 20 + i] for i in range(5)]
    assert [message.pose.pose.position.x for message in poses] == [20, 21, 22, 23, 24]
    assert closures == []
    node.context.try_shutdown()
    client.wait_for(lambda: len(open_map(path)) == 30, 'the places of today')


def test_no_frame_is_dropped_while_maps_are_saved_and_loaded(
    client, vpr, street, street_map, image, tmp_path, monkeypatch
):
    """Frames come all the while; the opening and the saving are held up until some have come."""
    first, other, copy = tmp_path / 'first.db', tmp_path / 'other.db', tmp_path / 'copy.db'
    save_map(street_map, other)
    node = vpr(map_path=first, save_map_path=copy, **ONLINE)
    held, sent = threading.Event(), 0
    indices = client.listen(Int32, '/vpr_node/match_index')
    camera = client.camera(Image)

    def slowly(function):
        return lambda *given, **more: held.wait(60) and function(*given, **more)

    def stream(condition):
        """Send a frame for every answer until something holds."""

        def step():
            nonlocal sent
            if len(indices) == sent:
                camera.publish(image(street[sent % 25], (LATER_S + sent) * SECOND))
                sent += 1
            return condition()

        client.wait_for(step)

    stream(lambda: sent > 10)
    for module, name, kind, target, request in (
        ('services.map_services.save_map', 'save_map', Trigger, save_map, {}),
        ('vpr_node.Pipeline', 'load_map', LoadMap, Pipeline, {'map_url': str(other)}),
    ):
        held.clear()
        with monkeypatch.context() as patch:
            patch.setattr(f'convseq_ros.node.{module}', slowly(target))
            service = client.service(kind, f'/vpr_node/{name}')
            future, before = service.call_async(kind.Request(**request)), sent
            stream(lambda before=before: sent > before + 10)
            assert not future.done()
            held.set()
            stream(future.done)
        answer = future.result()
        assert answer.success if kind is Trigger else not answer.result, answer
    client.wait_for(lambda: node._counters.processed == sent, 'every frame counted')
    client.wait_for(lambda: len(indices) == sent, 'every answer heard')
    assert (node._worker.dropped, node._counters.received) == (0, sent)
    assert 10 < len(open_map(copy)) < sent
    total = len(open_map(first))
    assert 20 < total < sent
    # From here on, the other map grows.
    assert len(node._recognition.pipeline.recognizer.reference_map) == 25 + sent - total


def test_the_map_that_grows_is_completed_where_it_is(client, vpr, street, image, tmp_path):
    path = tmp_path / 'new.db'
    vpr(map_path=path, **ONLINE)
    indices = client.listen(Int32, '/vpr_node/match_index')
    drive(client.camera(Image), street, image, range(7))
    client.wait_for(lambda: len(indices) == 7)
    answer = client.call(Trigger, '/vpr_node/save_map')
    assert (answer.success, answer.message) == (True, str(path))
    assert len(open_map(path)) == 7
    answer = client.call(LoadMap, '/vpr_node/load_map', map_url=str(path))
    assert answer.result == LoadMap.Response.RESULT_INVALID_MAP_DATA


def test_a_node_that_does_not_start_leaves_the_map_to_others(vpr, tmp_path, monkeypatch):
    path, table = tmp_path / 'new.db', tmp_path / 'rows.csv'
    full = Mock(side_effect=OSError(28, 'disk full'))
    monkeypatch.setattr('convseq_ros.node.outputs.result_log.ResultWriter', full)
    with pytest.raises(ConfigError, match=r'rows\.csv cannot be written \(disk full\)'):
        vpr(map_path=path, result_file=table, **ONLINE)
    vpr(map_path=path, **ONLINE)


@pytest.mark.parametrize('name', ['new.db', 'folder', 'absent/rows.csv', 'other.db'])
def test_a_result_file_that_cannot_be_written_or_costs_a_map_is_refused_at_the_start(
    vpr, tmp_path, name
):
    (tmp_path / 'folder').mkdir()
    save_map(ReferenceMap(), tmp_path / 'other.db')
    kept = (tmp_path / 'other.db').read_bytes()
    with pytest.raises(ConfigError, match=f'result_file: {tmp_path / name} '):
        vpr(map_path=tmp_path / 'new.db', result_file=tmp_path / name, **ONLINE)
    assert not (tmp_path / 'new.db').exists()
    assert (tmp_path / 'other.db').read_bytes() == kept


def test_diagnostics_report_an_error_while_the_map_cannot_be_written(
    client, vpr, street, image, tmp_path
):
    path, away = tmp_path / 'new.db', tmp_path / 'away.db'
    vpr(map_path=path, diagnostics_period_s=0.1, **ONLINE)
    indices = client.listen(Int32, '/vpr_node/match_index')
    diagnostics = client.listen(DiagnosticArray, '/diagnostics')
    camera = client.camera(Image)
    path.rename(away)
    drive(camera, street, image, range(8))
    client.wait_for(lambda: len(indices) == 8)

    def levels():
        return {message.status[0].level for message in diagnostics}

    client.wait_for(lambda: DiagnosticStatus.ERROR in levels(), 'the error')
    diagnostics.clear()
    client.wait_for(lambda: len(diagnostics) > 5)
    assert levels() == {DiagnosticStatus.ERROR}
    assert 'new.db: new places cannot be written' in diagnostics[-1].status[0].message
    answer = client.call(Trigger, '/vpr_node/save_map')
    assert not answer.success and 'was moved or replaced' in answer.message
    away.rename(path)
    assert client.call(Trigger, '/vpr_node/save_map').success
    client.wait_for(lambda: diagnostics[-1].status[0].level == DiagnosticStatus.OK, 'its end')


def test_the_node_subscribes_to_images_after_warming_up(
    client, vpr, map_path, show, monkeypatch, capfd
):
    warm, warm_up = threading.Event(), Pipeline.warm_up
    monkeypatch.setattr(Pipeline, 'warm_up', lambda of: warm.wait(60) and warm_up(of))
    vpr(map_path=map_path, fixed_length=1, diagnostics_period_s=0.1)
    diagnostics = client.listen(DiagnosticArray, '/diagnostics')
    client.wait_for(lambda: diagnostics)
    assert client.values_of(diagnostics[-1])['state'] == 'warming_up'
    assert diagnostics[-1].status[0].message == 'warming up'
    assert client.node.count_subscribers('/image') == 0
    warm.set()
    assert show(3) == 3
    client.wait_for(lambda: client.values_of(diagnostics[-1])['state'] == 'enabled')
    printed = ''.join(capfd.readouterr())
    assert 'kernel numpy, ready after' in printed
    assert printed.index('ready after') < printed.index('listening to /image')
