# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The managed node, over DDS: lifecycle_msgs' services, as a life cycle manager calls them."""

import os
import threading
from unittest.mock import Mock

from convseq_ros.app.pipeline import Pipeline
from convseq_ros.node import vpr_node
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from programs import wait_for
import pytest
from rclpy.context import Context
from sensor_msgs.msg import Image
from std_msgs.msg import Int32
from std_srvs.srv import Trigger

SECOND = 1_000_000_000
CONFIGURE, ACTIVATE = Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE
DEACTIVATE, CLEANUP = Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP
UNCONFIGURED, INACTIVE = State.PRIMARY_STATE_UNCONFIGURED, State.PRIMARY_STATE_INACTIVE
ACTIVE, FINALIZED = State.PRIMARY_STATE_ACTIVE, State.PRIMARY_STATE_FINALIZED


@pytest.fixture
def managed(client, vpr):
    """Return a maker of a managed node, with ways to change its state and to ask for it."""

    def make(**parameters):
        node = vpr(lifecycle='true', **parameters)

        def change(number):
            request = Transition(id=number)
            return client.call(ChangeState, '/vpr_node/change_state', transition=request).success

        def state():
            return client.call(GetState, '/vpr_node/get_state').current_state.id

        return node, change, state

    return make


def services_of(client):
    found = client.node.get_service_names_and_types()
    return {name for name, _ in found if name.startswith('/vpr_node/')}


def test_an_active_node_receives_images_and_a_pause_keeps_the_past(
    client, managed, map_path, street, image
):
    node, change, state = managed(map_path=map_path, fixed_length=2)
    assert state() == UNCONFIGURED
    assert '/vpr_node/localize' not in services_of(client)
    assert change(CONFIGURE) and state() == INACTIVE
    # The map is open, but nobody listens.
    client.wait_for(lambda: node._ready)
    assert not client.node.get_subscriptions_info_by_topic('/image')
    assert change(ACTIVATE) and state() == ACTIVE
    heard = client.listen(Int32, '/vpr_node/match_index')
    camera = client.camera(Image)
    camera.publish(image(street[3], SECOND))
    client.wait_for(lambda: len(heard) == 1)
    assert change(DEACTIVATE) and state() == INACTIVE
    client.wait_for(lambda: not camera.get_subscription_count())
    camera.publish(image(street[20], 2 * SECOND))
    assert change(ACTIVATE)
    client.wait_for(camera.get_subscription_count)
    camera.publish(image(street[4], 3 * SECOND))
    client.wait_for(lambda: len(heard) == 2)
    # A sequence of two: the frame from before the pause is its first.
    assert [each.data for each in heard] == [-1, 4]


def test_cleanup_releases_files_and_topics_and_the_node_can_start_again(
    client, managed, map_path, tmp_path, street, image
):
    table = tmp_path / 'result.csv'
    _, change, state = managed(map_path=map_path, fixed_length=1, result_file=table)
    assert state() == UNCONFIGURED
    for _ in range(2):
        before = services_of(client)
        assert change(CONFIGURE) and change(ACTIVATE)
        heard = client.listen(Int32, '/vpr_node/match_index')
        camera = client.camera(Image)
        camera.publish(image(street[7], SECOND))
        client.wait_for(lambda heard=heard: heard)
        assert heard[0].data == 7
        assert change(DEACTIVATE) and change(CLEANUP) and state() == UNCONFIGURED
        assert len(table.read_text().splitlines()) == 2
        client.wait_for(lambda before=before: services_of(client) == before)
        client.node.destroy_publisher(camera)
    assert len((tmp_path / 'result.1.csv').read_text().splitlines()) == 2
    assert 'worker' not in {thread.name for thread in threading.enumerate()}


def test_cleanup_during_warm_up_releases_the_map(client, managed, tmp_path, monkeypatch):
    warming = threading.Event()
    node, change, state = managed(map_path=tmp_path / 'map.db', mode='online')

    def warm_up(_session):
        warming.set()
        wait_for(lambda: node._worker.is_stopping)

    monkeypatch.setattr(Pipeline, 'warm_up', warm_up)
    for _ in range(2):
        warming.clear()
        assert change(CONFIGURE) and warming.wait(60)
        assert change(CLEANUP) and state() == UNCONFIGURED
        assert [each.name for each in tmp_path.iterdir()] == ['map.db']


def test_a_call_that_waits_while_the_node_is_shut_down_ends_nothing(client, managed, map_path):
    node, change, state = managed(map_path=map_path)
    assert change(CONFIGURE) and change(ACTIVATE)
    client.service(Trigger, '/vpr_node/localize').call_async(Trigger.Request())
    client.wait_for(lambda: node._localization._waiting)
    assert change(Transition.TRANSITION_ACTIVE_SHUTDOWN)
    client.wait_for(lambda: not node._localization._waiting)
    assert state() == FINALIZED


@pytest.mark.parametrize('cause', ['no map', 'an error that nobody foresaw'])
def test_what_cannot_be_configured_is_refused_and_holds_no_map(
    managed, tmp_path, monkeypatch, cause
):
    path = tmp_path / 'map.db'
    _, change, state = managed(map_path=path, mode='preloaded' if cause == 'no map' else 'online')
    with monkeypatch.context() as patched:
        if cause != 'no map':
            patched.setattr(vpr_node, 'Counters', Mock(side_effect=RuntimeError(cause)))
        for _ in range(2):
            assert not change(CONFIGURE) and state() == UNCONFIGURED
    if cause != 'no map':
        assert change(CONFIGURE) and state() == INACTIVE


def test_an_impossible_transition_is_refused_and_the_state_stays(client, managed, map_path, capfd):
    _, change, state = managed(map_path=map_path)
    assert not change(ACTIVATE) and not change(99) and state() == UNCONFIGURED
    told = 'transition 3 is not possible: the node is unconfigured; call configure (1) or'
    assert told in capfd.readouterr().err
    assert change(CONFIGURE) and not change(CONFIGURE) and state() == INACTIVE
    # Inactive, it answers services.
    answer = client.call(Trigger, '/vpr_node/localize')
    assert not answer.success and 'activate' in answer.message
    assert change(Transition.TRANSITION_INACTIVE_SHUTDOWN) and state() == FINALIZED
    assert not change(CONFIGURE)
    assert 'the node is finalized; end it and start it again' in capfd.readouterr().err


def test_a_node_that_is_destroyed_leaves_the_graph(client):
    context = Context()
    context.init(domain_id=int(os.environ['ROS_DOMAIN_ID']))
    node = vpr_node.VprNode(
        context=context, cli_args=['--ros-args', '-r', '__node:=gone', '-p', 'lifecycle:=true']
    )
    client.wait_for(lambda: 'gone' in client.node.get_node_names())
    node.destroy_node()
    # The context, and with it the participant, lives on.
    client.wait_for(lambda: 'gone' not in client.node.get_node_names(), timeout_s=10)
    context.try_shutdown()
