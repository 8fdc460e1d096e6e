# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Callbacks are called by a thread of their own, and no message ends the node."""

import threading
from unittest.mock import Mock

from convseq_ros.node.inputs.following_subscription import FollowingSubscription
from convseq_ros.node.inputs.listener import ListeningNode
from convseq_ros.node.running import spin
import pytest
import rclpy
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Int32
from std_srvs.srv import Trigger


def heard_numbers(client, node, callback):
    """Return a publisher of numbers, and the subscription to them."""
    subscription = FollowingSubscription(node, Int32, '/number', callback, 10)
    publisher = client.node.create_publisher(Int32, '/number', 10)
    client.wait_for(publisher.get_subscription_count)
    return publisher, subscription


def test_messages_arrive_without_a_spinning_executor(client):
    node, heard = ListeningNode('listening', context=client.node.context), []
    publisher, subscription = heard_numbers(client, node, heard.append)
    for number in range(5):
        publisher.publish(Int32(data=number))
    client.wait_for(lambda: [message.data for message in heard] == [0, 1, 2, 3, 4])
    subscription.stop()
    client.wait_for(lambda: not publisher.get_subscription_count())
    assert 'listener' in {thread.name for thread in threading.enumerate()}
    node.destroy_node()
    assert 'listener' not in {thread.name for thread in threading.enumerate()}


def test_a_callback_that_fails_is_logged_and_called_again(client, monkeypatch):
    node = ListeningNode('listening', context=client.node.context)
    logger, heard = Mock(), []

    def fail_first(message):
        heard.append(message.data)
        assert message.data

    monkeypatch.setattr(node, 'get_logger', lambda: logger)
    publisher, _ = heard_numbers(client, node, fail_first)
    publisher.publish(Int32(data=0))
    publisher.publish(Int32(data=1))
    client.wait_for(lambda: heard == [0, 1])
    assert 'AssertionError' in logger.error.call_args.args[0]
    node.destroy_node()


SECOND = 1_000_000_000


def test_a_clock_below_zero_is_left_out_and_the_next_time_is_used(client, vpr):
    node = vpr('-p', 'use_sim_time:=true')
    clock = client.camera(Clock, '/clock')
    for sec in (-5, 7):
        message = Clock()
        message.clock.sec = sec
        clock.publish(message)
    client.wait_for(lambda: node.get_clock().now().nanoseconds == 7 * SECOND)


@pytest.fixture
def process_node():
    """Return a node in the context of the process, as `main` makes one."""
    rclpy.init()
    node = Node('node')
    yield node
    node.destroy_node()
    rclpy.try_shutdown()


def test_the_error_of_a_callback_is_logged_and_the_next_one_is_served(process_node, monkeypatch):
    logger = Mock()
    monkeypatch.setattr(process_node, 'get_logger', lambda: logger)
    asked = []

    def answer(_request, response):
        asked.append(response)
        if len(asked) == 1:
            raise RuntimeError('nobody foresaw this')
        response.success = True
        return response

    process_node.create_service(Trigger, '~/ask', answer)
    service = process_node.create_client(Trigger, '~/ask')
    first = service.call_async(Trigger.Request())
    turns = spin(process_node)
    while not asked:
        next(turns)
    second = service.call_async(Trigger.Request())
    while not second.done():
        next(turns)
    assert second.result().success and not first.done()
    assert 'nobody foresaw this' in logger.error.call_args.args[0]
