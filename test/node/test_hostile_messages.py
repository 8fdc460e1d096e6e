# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""No message ends the node, whatever callback it reaches."""

from unittest.mock import Mock

from convseq_ros.node.running import spin
import pytest
import rclpy
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

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
