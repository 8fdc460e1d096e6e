# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The pose graph as a node: topics in, `map -> odom`, path, diagnostics and files out."""

import math
import os
from pathlib import Path
import sys
import types
from unittest.mock import Mock

from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.writer import save_map
from convseq_ros.core.rigid import inverse, matrix, pose_of, turned_by
from convseq_ros.errors import ConvseqError
from convseq_ros.node.conversions import pose_only_message, stamp_from_ns, stamp_to_ns
from convseq_ros.pose_graph.problem import Problem
from convseq_ros.sources.pose_track import pose_from_message
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from nav_msgs.msg import Path as PathMessage
import numpy as np
from programs import run
import pytest
from rclpy.parameter import Parameter
from squares import add_drive, MEASURED, SECOND, squares, stamp
from std_msgs.msg import Float64MultiArray, Header
from std_srvs.srv import Trigger

pytest.importorskip('gtsam', reason='needs gtsam: pip install gtsam')

LAP, NUM = 40, 80
EXACT = MEASURED.ravel()
TRUE, DRIFTED = squares(side=10), squares(scale=1.03, excess_rad=0.06, side=10)


def odometry(step: int, frame_id: str = 'odom') -> Odometry:
    message = Odometry(header=Header(stamp=stamp_from_ns(stamp(step)), frame_id=frame_id))
    message.pose.pose = pose_only_message(pose_of(DRIFTED[step]))
    return message


def closure(query: int, reference: int, session: str = 'a', own: str = 'a') -> Odometry:
    message = Odometry(header=Header(stamp=stamp_from_ns(stamp(query))))
    message.header.frame_id = f'{session}/{stamp(reference)}'
    message.child_frame_id = f'{own}/{stamp(query)}'
    moved = inverse(TRUE[reference]) @ TRUE[query]
    message.pose.pose, message.pose.covariance = pose_only_message(pose_of(moved)), EXACT
    return message


def map_info(map_id: str = 'the map', last_ns: int = 0, sessions: str = 'a') -> DiagnosticArray:
    values = {'map_id': map_id, 'last_stamp_ns': last_ns, 'session_ids': sessions}
    pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    return DiagnosticArray(status=[DiagnosticStatus(values=pairs)])


@pytest.fixture
def graph_node(client):
    """Return a maker of a node that the client's executor serves, too."""
    from convseq_ros.node.pose_graph_node import PoseGraphNode

    made = []

    def make(*ros_args: str, **parameters: object) -> PoseGraphNode:
        words = [w for name, value in parameters.items() for w in ('-p', f'{name}:={value}')]
        words += ['-p', 'graph_spacing_m:=0.9', '-p', 'period_s:=0.05', *ros_args]
        node = PoseGraphNode(context=client.node.context, cli_args=['--ros-args', *words])
        client.executor.add_node(node)
        made.append(node)
        return node

    yield make
    for node in made:
        client.executor.remove_node(node)
        node.destroy_node()


def drive(node, first: int = 0, last: int = NUM) -> None:
    for step in range(first, last + 1):
        node._odometry.hear(odometry(step))


def close(client, node, *closures: Odometry) -> None:
    """Give a node closures, and wait until they are solved."""
    for one in closures:
        node._on_closure(one)
    client.wait_for(lambda: all(k.kept is not None for k in node._graph.known.values()))


RIGHT = [closure(LAP + at, at) for at in range(2, LAP, 6)]


def test_over_topics_a_drive_is_corrected_and_a_false_closure_is_refused_and_reported(
    client, graph_node, monkeypatch
):
    node = graph_node()
    monkeypatch.setattr(node, 'get_logger', Mock())
    heard = {
        name: client.listen(kind, name)
        for name, kind in (
            ('/pose_graph_node/map_to_odom', TransformStamped),
            ('/pose_graph_node/path', PathMessage),
            ('/diagnostics', DiagnosticArray),
        )
    }
    moved, path, told = heard.values()
    publish = {
        name: client.camera(kind, name)
        for name, kind in (
            ('/odom', Odometry),
            ('/vpr_node/closure_odometry', Odometry),
            ('/vpr_node/loop_closure', Float64MultiArray),
        )
    }
    for step in range(NUM + 1):
        publish['/odom'].publish(odometry(step))
    for one in RIGHT:
        publish['/vpr_node/closure_odometry'].publish(one)
    # By hand: the two times of places that are 14 m apart.
    publish['/vpr_node/loop_closure'].publish(
        Float64MultiArray(data=[stamp(60) / 1e9, stamp(4) / 1e9])
    )

    def counts():
        values = client.values_of(told[-1])
        return values['keyframes'], values['kept'], values['refused']

    wanted = str(NUM + 1), str(len(RIGHT)), '1'
    client.wait_for(lambda: counts() == wanted)
    assert told[-1].status[0].level == DiagnosticStatus.OK
    (warning,) = [call.args[0] for call in node.get_logger().warning.call_args_list]
    assert warning.startswith('closure of 13.000 with 1.800 is refused: ')
    # As REP-105 has it: map -> odom, at a time of odometry, moves its pose to the end of the path.
    path.clear()
    publish['/odom'].publish(last := odometry(NUM))
    last.header.stamp = stamp_from_ns(stamp(NUM + 1))
    publish['/odom'].publish(last)
    client.wait_for(lambda: moved[-1].header.stamp == last.header.stamp and path)
    assert (moved[-1].header.frame_id, moved[-1].child_frame_id) == ('map', 'odom')
    shift = moved[-1].transform
    there = types.SimpleNamespace(position=shift.translation, orientation=shift.rotation)
    end = matrix(pose_from_message(there)) @ DRIFTED[NUM]
    assert np.allclose(end, matrix(pose_from_message(path[-1].poses[-1].pose)), atol=1e-6)
    assert path[-1].header.frame_id == 'map' and len(path[-1].poses) == NUM + 1
    off_m = np.linalg.norm(end[:3, 3] - TRUE[NUM][:3, 3])
    assert off_m < 0.3 * np.linalg.norm(DRIFTED[NUM][:3, 3] - TRUE[NUM][:3, 3])


def test_a_robot_that_was_carried_away_is_warned_of_until_three_closures_agree(
    client, graph_node, monkeypatch
):
    node = graph_node()
    monkeypatch.setattr(node, 'get_logger', Mock())
    drive(node)
    close(client, node, *RIGHT[:3])
    # Carried to where it was 30 steps before, which odometry does not see.
    away = [closure(LAP + at, at - 30) for at in (32, 35, 38)]
    for one, at in zip(away, (32, 35, 38), strict=True):
        before = inverse(TRUE[at - 30]) @ TRUE[at - 30]
        one.pose.pose = pose_only_message(pose_of(before))
    close(client, node, away[0])
    level, text = node._state(node._graph.counts)
    assert level == DiagnosticStatus.WARN and 'the newest 1 contradict odometry' in text
    close(client, node, *away[1:])
    client.wait_for(lambda: node._graph.counts['carried'])
    client.wait_for(lambda: node._state(node._graph.counts)[0] == DiagnosticStatus.OK)

    def told() -> str:  # by the solver's thread, after the counts
        return ''.join(call.args[0] for call in node.get_logger().warning.call_args_list)

    client.wait_for(lambda: 'contradict odometry at 15.400: the robot was carried away' in told())


def test_a_localised_robot_that_is_lost_may_have_been_carried(graph_node):
    node = graph_node()
    drive(node, last=10)
    for state in ('lost', 'localised', 'candidate', 'lost', 'localised'):
        node._on_localization(DiagnosticStatus(message=state))
    assert node._graph.running.hints == [12]


def test_files_are_written_by_the_service_and_at_the_end(client, graph_node, tmp_path):
    names = {'tum_file': 'path.txt', 'g2o_file': 'path.g2o'}
    files = {name: tmp_path / file for name, file in names.items()}
    node = graph_node(**files)
    drive(node)
    close(client, node, *RIGHT)
    answer = client.call(Trigger, '/pose_graph_node/save')
    assert answer.success and all(str(path) in answer.message for path in files.values())
    _, *lines = files['tum_file'].read_text().splitlines()  # after a comment
    assert len(lines) == NUM + 1 and lines[0].startswith('1.000000000 ')
    kinds = [line.split()[0] for line in files['g2o_file'].read_text().splitlines()]
    assert kinds.count('VERTEX_SE3:QUAT') == NUM + 1
    assert kinds.count('EDGE_SE3:QUAT') == NUM + len(RIGHT)
    stamps = (tmp_path / 'path.g2o.csv').read_text().splitlines()[1:]
    assert stamps[:2] == ['vertex,stamp_ns', f'1,{stamp(0)}'] and len(stamps) == NUM + 2
    for path in files.values():
        path.unlink()
    # Elsewhere, from now on; a file of others stays.
    node.set_parameters([Parameter('tum_file', value=str(tmp_path / 'other.txt'))])
    assert client.call(Trigger, '/pose_graph_node/save').success
    assert (tmp_path / 'other.txt').exists() and not files['tum_file'].exists()
    (tmp_path / 'mine.txt').write_text('mine')
    node.set_parameters([Parameter('tum_file', value=str(tmp_path / 'mine.txt'))])
    answer = client.call(Trigger, '/pose_graph_node/save')
    assert not answer.success and 'was not written by this program' in answer.message
    node.set_parameters([Parameter('tum_file', value=str(files['tum_file']))])
    client.executor.remove_node(node)
    node.destroy_node()
    assert all(path.exists() for path in files.values())


def test_files_that_are_not_written_are_told(client, graph_node, tmp_path, capfd):
    (folder := tmp_path / 'gone').mkdir()
    node = graph_node(tum_file=folder / 'path.txt')
    answer = client.call(Trigger, '/pose_graph_node/save')
    assert not answer.success and 'nothing to write' in answer.message
    folder.rmdir()
    client.executor.remove_node(node)
    node.destroy_node()
    assert 'cannot be written: there is no folder' in capfd.readouterr().err


@pytest.fixture
def town_map(tmp_path):
    """Return the file of a map in which the drive is, up to its 71st pose, and its closures."""
    made = ReferenceMap()
    closed = [(LAP + at, at, inverse(TRUE[at]) @ TRUE[LAP + at]) for at in range(2, 30, 6)]
    add_drive(made, DRIFTED[:71], closed)
    save_map(made, path := tmp_path / 'town.db')
    return path, made


def test_a_killed_node_goes_on_where_it_was(client, graph_node, town_map):
    path, made = town_map
    node, publisher = graph_node(map_path=path), client.camera(Odometry, '/odom')
    told = client.listen(TransformStamped, '/pose_graph_node/map_to_odom')
    for step in (68, 69, 70, 71, 72):  # the map has the first ones, too
        publisher.publish(odometry(step))
    client.wait_for(lambda: told)
    assert [stamp_to_ns(one.header.stamp) for one in told] == [stamp(71)]  # 20 Hz at most
    shift = told[0].transform
    there = types.SimpleNamespace(position=shift.translation, orientation=shift.rotation)
    correction = matrix(pose_from_message(there))
    off_m = np.linalg.norm((correction @ DRIFTED[71] - TRUE[71])[:3, 3])
    assert off_m < 0.3 * np.linalg.norm((DRIFTED[71] - TRUE[71])[:3, 3])
    assert node._graph.counts['kept'] == 5 and not node._graph.earlier
    node._on_map(map_info(made.map_id, sessions=made.sessions[0].id))
    assert node._graph.running.sessions == {made.sessions[0].id}


def test_odometry_of_another_frame_is_carried_to_the_base_by_static_tf(
    client, graph_node, monkeypatch
):
    """As by the recogniser: both use `odom` alike."""
    base = types.SimpleNamespace(x=-0.3, y=0.2, z=-1.0)  # in the frame of the IMU
    turn = types.SimpleNamespace(x=0.0, y=0.0, z=math.sqrt(0.5), w=math.sqrt(0.5))
    moved = types.SimpleNamespace(translation=base, rotation=turn)

    class Buffer:
        def can_transform(self, target, source, _time):
            return (target, source) == ('imu', 'robot')

        def lookup_transform(self, *_frames):
            header = types.SimpleNamespace(stamp=stamp_from_ns(0))
            return types.SimpleNamespace(header=header, transform=moved)

    tf = types.SimpleNamespace(Buffer=Buffer, TransformListener=lambda _buffer, _node: None)
    monkeypatch.setitem(sys.modules, 'tf2_ros', tf)
    node, publisher = graph_node(base_frame='robot'), client.camera(Odometry, '/odom')
    in_base = np.eye(4)
    in_base[:3, :3], in_base[:3, 3] = turned_by((0, 0, math.pi / 2)), (-0.3, 0.2, -1.0)
    for step in range(6):
        message = odometry(step)
        message.child_frame_id = '/imu'
        of_imu = DRIFTED[step] @ inverse(in_base)
        message.pose.pose = pose_only_message(pose_of(of_imu))
        publisher.publish(message)
    client.wait_for(lambda: len(node._graph.running.poses) == 6)
    assert np.allclose(node._graph.running.poses, DRIFTED[:6], atol=1e-9)


def test_odometry_that_tf_cannot_carry_is_left_out_with_a_line(graph_node, monkeypatch):
    node = graph_node()
    warning = Mock()
    monkeypatch.setattr(node._odometry, '_logger', Mock(warning=warning))
    for step in range(16):  # 3 s
        message = odometry(step)
        message.child_frame_id = 'imu'
        node._odometry.hear(message)
    assert not node._graph.running.poses
    assert 'poses are of imu, and static TF has no way' in warning.call_args.args[0]


def test_the_recogniser_alone_was_killed_and_what_it_made_before_is_known(client, graph_node):
    node = graph_node()
    drive(node)
    close(client, node, *RIGHT[:3])
    before = [closure(LAP + at, at, own='b') for at in (20, 26)]  # places of session a
    close(client, node, *before)
    assert node._graph.running.sessions == {'a', 'b'}
    assert node._graph.counts['kept'] == 5 and not node._graph.without_place


def test_evo_reads_the_trajectory(client, graph_node, tmp_path):
    file_interface = pytest.importorskip('evo.tools.file_interface')
    node = graph_node(tum_file=tmp_path / 'path.txt')
    drive(node)
    assert node._save() == f'written: {tmp_path / "path.txt"}'
    read = file_interface.read_tum_trajectory_file(str(tmp_path / 'path.txt'))
    assert read.timestamps[-1] == pytest.approx(stamp(NUM) / 1e9)
    ends = np.array(DRIFTED)[:, :3, 3]
    assert np.abs(read.positions_xyz - ends).max() < 1e-6


# Bad input.


def test_two_nodes_with_two_maps_are_reported(client, graph_node, town_map):
    path, _ = town_map
    node, publisher = graph_node(map_path=path), client.camera(Odometry, '/odom')
    publisher.publish(odometry(71))
    node._backlog.before(node._on_map)(DiagnosticArray())  # a message that makes trouble
    client.wait_for(lambda: not node._backlog.is_waiting)
    node._on_map(map_info('another map', stamp(70)))
    assert f'{path} is not the map that vpr_node uses' in node._state(node._graph.counts)[1]
    drive(node, 72, 73)
    assert node._graph.correction is None and not node._graph.known


def test_a_map_that_is_damaged_meanwhile_is_reported_and_nothing_is_guessed(
    client, graph_node, town_map
):
    path, _ = town_map
    node, publisher = graph_node(map_path=path), client.camera(Odometry, '/odom')
    path.write_bytes(b'no map')
    publisher.publish(odometry(71))
    client.wait_for(lambda: node._graph.running.keyframes)
    level, text = node._state(node._graph.counts)
    assert level == DiagnosticStatus.ERROR and 'the map is not read: ' in text
    assert node._graph.correction is None


def test_a_graph_that_is_not_solved_is_an_error_until_it_is(client, graph_node, monkeypatch):
    node = graph_node()
    drive(node)

    def state() -> tuple[bytes, str]:
        return node._state(node._graph.counts)

    with monkeypatch.context() as patch:
        patch.setattr(Problem, 'solve', Mock(side_effect=RuntimeError('singular')))
        node._on_closure(RIGHT[0])
        client.wait_for(lambda: state()[0] == DiagnosticStatus.ERROR)
        assert state()[1].startswith('the graph is not solved: ') and 'singular' in state()[1]
    close(client, node, *RIGHT[1:])
    client.wait_for(lambda: state()[0] == DiagnosticStatus.OK)


@pytest.mark.parametrize(('content', 'told'), [(b'no map', 'not a convseq map'), (b'', '')])
def test_a_damaged_map_ends_the_start_and_one_that_is_not_made_yet_does_not(
    graph_node, tmp_path, content, told
):
    path = tmp_path / 'map.db'
    path.write_bytes(content)
    if told:
        with pytest.raises(ConvseqError, match=told):
            graph_node(map_path=path)
    else:
        assert graph_node(map_path=path)._graph.counts['keyframes'] == 0
    assert path.read_bytes() == content


def test_a_file_that_costs_another_or_has_no_folder_is_refused_at_the_start(graph_node, tmp_path):
    path = tmp_path / 'path.txt'
    with pytest.raises(ConvseqError, match=r'tum_file: .*: there is no folder'):
        graph_node(tum_file=tmp_path / 'none' / 'path.txt')
    with pytest.raises(ConvseqError, match=r'g2o_file: .* written by the same'):
        graph_node(tum_file=path, g2o_file=path)


@pytest.mark.parametrize(
    'change',
    [
        {'frame': 'base_link'},
        {'child': 'a/none'},
        {'covariance': [math.nan] * 36},
        {'covariance': [-1.0] * 36},
        {'x': math.inf},
    ],
)
def test_a_message_that_is_no_closure_is_left_out_and_reported(graph_node, change, monkeypatch):
    node = graph_node()
    monkeypatch.setattr(node, 'get_logger', Mock())
    message = closure(50, 10)
    message.header.frame_id = change.get('frame', message.header.frame_id)
    message.child_frame_id = change.get('child', message.child_frame_id)
    message.pose.covariance = change.get('covariance', message.pose.covariance)
    message.pose.pose.position.x = change.get('x', 0.0)
    node._on_closure(message)
    node._on_pair(Float64MultiArray(data=[1.0]))
    assert not node._graph.known
    assert node.get_logger().warning.call_count == 2


def test_closures_and_odometry_of_two_clocks_are_reported(client, graph_node, monkeypatch):
    node = graph_node()
    monkeypatch.setattr(node, 'get_logger', Mock())
    drive(node)
    by_uptime = closure(60, 20)
    by_uptime.child_frame_id = f'a/{stamp(60) + 1000 * SECOND}'
    node._on_closure(by_uptime)
    client.wait_for(lambda: node._graph.apart_ns)
    level, text = node._state(node._graph.counts)
    assert level == DiagnosticStatus.WARN
    assert 'a closure is of 1013.000, when odometry, at 17.000, was not' in text


def test_a_covariance_that_is_not_finite_is_left_out_and_reported(graph_node, monkeypatch):
    node = graph_node()
    monkeypatch.setattr(node, 'get_logger', Mock())
    for step in range(3):
        message = odometry(step)
        message.pose.covariance[0] = math.inf
        node._odometry.hear(message)
    (line,) = {call.args[0] for call in node.get_logger().warning.call_args_list}
    assert 'a covariance of inf m2 and 0 rad2 is left out' in line
    assert len(node._graph.running.keyframes) == 3
    assert np.isfinite(node._graph.running.spread).all()


def test_an_odometry_reset_and_a_backward_clock_jump_are_reported(graph_node, monkeypatch):
    node = graph_node()
    monkeypatch.setattr(node, 'get_logger', Mock())
    drive(node, last=30)
    jumped = odometry(31)
    jumped.pose.pose.position.x += 500.0
    node._odometry.hear(jumped)
    drive(node, 0, 5)
    lines = [call.args[0] for call in node.get_logger().warning.call_args_list]
    assert lines[0].startswith('odometry was reset')
    assert lines[1].startswith('the clock was set back')
    assert node._graph.counts['keyframes'] == 6


def test_a_pose_graph_node_without_gtsam_ends_with_one_line(tmp_path):
    pytest.importorskip('rclpy')
    (tmp_path / 'gtsam.py').write_text('raise ImportError("none")\n')
    paths = os.pathsep.join([str(tmp_path), *sys.path])
    code = 'from convseq_ros.node.pose_graph_node import main; raise SystemExit(main())'
    result = run(sys.executable, '-c', code, env=os.environ | {'PYTHONPATH': paths}, timeout=180)
    assert result.returncode == 1
    (line,) = [text for text in result.stderr.splitlines() if 'INFO' not in text]
    assert line.endswith('a pose graph needs gtsam: pip install gtsam')


# TF: tf2_msgs is not on PyPI, so what would be on /tf is recorded.


def test_the_pose_graph_node_has_its_two_executables():
    assert (Path(sys.prefix) / 'bin' / 'pose_graph_node').is_file()
    assert (Path(sys.prefix) / 'lib' / 'convseq_ros' / 'pose_graph_node').is_file()
