# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages reach callbacks in a thread of their own, whatever the executor does."""

import threading
from unittest.mock import Mock

from convseq_ros.node.inputs.following_subscription import FollowingSubscription
from convseq_ros.node.inputs.listener import ListeningNode
import pytest
from std_msgs.msg import Int32


@pytest.fixture
def node(client):
    """Return a node that no executor serves."""
    made = ListeningNode('listening', context=client.node.context)
    yield made
    made.destroy_node()


def test_messages_arrive_without_a_spinning_executor(client, node):
    heard = []
    subscription = FollowingSubscription(node, Int32, '/number', heard.append, 10)
    publisher = client.node.create_publisher(Int32, '/number', 10)
    client.wait_for(publisher.get_subscription_count)
    for number in range(5):
        publisher.publish(Int32(data=number))
    client.wait_for(lambda: [message.data for message in heard] == [0, 1, 2, 3, 4])
    subscription.stop()
    client.wait_for(lambda: not publisher.get_subscription_count())


def test_a_callback_that_fails_is_logged_and_called_again(client, node, monkeypatch):
    logger, heard = Mock(), []

    def fail_first(message):
        heard.append(message.data)
        assert message.data

    monkeypatch.setattr(node, 'get_logger', lambda: logger)
    FollowingSubscription(node, Int32, '/number', fail_first, 10)
    publisher = client.node.create_publisher(Int32, '/number', 10)
    client.wait_for(publisher.get_subscription_count)
    publisher.publish(Int32(data=0))
    publisher.publish(Int32(data=1))
    client.wait_for(lambda: heard == [0, 1])
    assert 'AssertionError' in logger.error.call_args.args[0]


def test_the_thread_ends_with_its_node(client):
    node = ListeningNode('listening', context=client.node.context)
    FollowingSubscription(node, Int32, '/number', Mock(), 10)
    assert any(thread.name == 'listener' for thread in threading.enumerate())
    node.destroy_node()
    assert not any(thread.name == 'listener' for thread in threading.enumerate())
