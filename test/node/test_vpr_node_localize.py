# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the robot is: asked for, published when it changes, and why it is not known."""

from functools import cache
from itertools import pairwise
import math
import threading
from unittest.mock import Mock

from convseq_ros.node.services import localization
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.srv import LoadMap
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_srvs.srv import SetBool, Trigger

UNKNOWN = None
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@pytest.fixture
def ask(client):
    """Return a way to ask where the robot is: a future for each call."""

    @cache
    def service():
        return client.service(Trigger, '/vpr_node/localize')

    return lambda count=1: [service().call_async(Trigger.Request()) for _ in range(count)]


def answers(client, futures):
    for future in futures:
        client.wait_for(future.done, 'an answer of ~/localize')
    return [future.result() for future in futures]


def test_all_waiting_localize_calls_are_answered_by_the_localising_frame(
    client, vpr, map_path, show, ask
):
    vpr(map_path=map_path, fixed_length=1, localize_timeout_s=60.0)
    states = client.listen(DiagnosticStatus, '/vpr_node/localization', LATCHED)
    show(3)
    # A call that came between the answer to a frame and its state would have that frame's place.
    client.wait_for(lambda: states[-1].message == 'localised')
    futures = ask(2)
    show(4)
    first, second = answers(client, futures)
    assert first.success and second.success
    assert first.message == second.message
    # The street's places lie along x, 1 m apart, at y 2 and z 0.5, turned by 2 atan(.6 / .8).
    assert first.message.startswith('place 4, quality not known; x 4.00 y 2.00 z 0.50 m (sigma ')
    assert 'yaw 1.287 rad' in first.message and 'in frame map' in first.message
    assert 'not calibrated' in first.message


def test_every_change_of_the_state_is_published_and_latched_with_one_initial_pose(
    client, vpr, map_path, show
):
    remap = '-r', 'initialpose:=/amcl/initialpose'
    vpr(*remap, map_path=map_path, publish_initial_pose='true', matching='coherent')
    told = client.listen(DiagnosticStatus, '/vpr_node/localization', LATCHED)
    poses = client.listen(PoseWithCovarianceStamped, '/amcl/initialpose', LATCHED)
    client.wait_for(lambda: told)
    show(1, 2, 3, 4, *[UNKNOWN] * 16, 20, 21, 22, 23)
    client.wait_for(lambda: len(poses) == 2 and told[-1].message == 'localised')
    states = [each.message for each in told]
    assert all(one != next_one for one, next_one in pairwise(states))
    assert states[:3] == ['lost', 'candidate', 'localised'] and states.count('localised') == 2
    assert 'lost' in states[3:]
    assert poses[0].pose.pose.position.x in (1.0, 2.0)
    assert poses[1].pose.pose.position.x in (20.0, 21.0, 22.0)
    # Whoever comes late hears the last state, and the last pose.
    late = client.listen(DiagnosticStatus, '/vpr_node/localization', LATCHED)
    last = client.listen(PoseWithCovarianceStamped, '/amcl/initialpose', LATCHED)
    client.wait_for(lambda: late and last)
    assert late[0].message == 'localised' and late[0].level == DiagnosticStatus.OK
    values = {item.key: item.value for item in late[0].values}
    assert values['problem'] == '' and float(values['quality']) >= 0.9
    assert last[0].pose.pose.position.x >= 20.0 and len(last) == 1
    assert last[0].header.frame_id == 'map' and last[0].pose.covariance[0] > 0


def pose_of_others(x, frame_id='map', sigma_m=1.0):
    """Return what RViz sends: on the ground, with no variance of the height."""
    message = PoseWithCovarianceStamped()
    message.header.frame_id = frame_id
    message.pose.pose.position.x, message.pose.pose.position.y = x, 2.0
    message.pose.pose.orientation.w = 1.0
    message.pose.covariance[0] = message.pose.covariance[7] = sigma_m**2
    return message


def test_others_say_where_to_look_first_and_what_the_node_sends_itself_is_passed_over(
    client, vpr, map_path, show
):
    node = vpr(map_path=map_path, publish_initial_pose='true', matching='coherent')
    sent = client.listen(PoseWithCovarianceStamped, '/initialpose', LATCHED)
    others = client.camera(PoseWithCovarianceStamped, '/initialpose')
    expect = Mock(wraps=node._recognition.pipeline.cameras.expect)
    node._recognition.pipeline.cameras.expect = expect
    for message in (
        pose_of_others(8.0, 'odom'),
        pose_of_others(math.inf),
        pose_of_others(8.0, sigma_m=math.nan),
        pose_of_others(1000.0),
        pose_of_others(8.0, '/map'),
    ):
        others.publish(message)
    client.wait_for(lambda: expect.call_count == 2)
    assert show(8) == 8  # as offline, at once
    client.wait_for(lambda: sent)  # its own, which came before the next one
    others.publish(pose_of_others(20.0))
    client.wait_for(lambda: expect.call_count == 3)
    assert expect.call_args.args[0].pose.position == (20.0, 2.0, 0.0)
    assert show(20) == 20
    assert node._situation().further['initial_poses_left_out'] == 4


def test_waiting_localize_calls_take_no_threads_and_too_many_are_refused(
    client, vpr, map_path, show, ask, monkeypatch
):
    monkeypatch.setattr(localization, '_MOST_CALLS', 5)
    vpr(map_path=map_path, fixed_length=1, localize_timeout_s=60.0)
    show(3)
    before = threading.active_count()
    futures = ask(8)
    client.wait_for(lambda: sum(future.done() for future in futures) == 3)
    assert threading.active_count() <= before
    told = {one.result().message.split(';')[0] for one in futures if one.done()}
    assert told == {'more than 5 calls wait'}
    show(4)
    assert sum(one.success for one in answers(client, futures)) == 5


def test_localize_without_images_reports_that_none_come(client, vpr, map_path, ask):
    vpr(map_path=map_path, localize_timeout_s=0.1)
    (answer,) = answers(client, ask())
    assert not answer.success
    assert answer.message.startswith('no images: /image has no publisher')


def test_localize_without_a_map_or_when_disabled_fails_at_once(client, vpr, ask, map_path):
    vpr(localize_timeout_s=3600.0)
    (answer,) = answers(client, ask())
    assert not answer.success
    assert answer.message == 'there is no map; call /vpr_node/load_map or set map_path'
    client.call(LoadMap, '/vpr_node/load_map', map_url=str(map_path))
    client.call(SetBool, '/vpr_node/set_enabled', data=False)
    (answer,) = answers(client, ask())
    assert answer.message.startswith('disabled; call /vpr_node/set_enabled')
