# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Live depth images: each frame gets the one of its moment, or goes on without."""

import threading
from unittest.mock import Mock

from convseq_ros.node import frame_context as module
from convseq_ros.node.conversions import stamp_from_ns
from convseq_ros.reading_config import ReadingConfig
import numpy as np
import pytest
from sensor_msgs.msg import Image

SECOND, MS = 1_000_000_000, 1_000_000


def depth(stamp_ns, millimetres=1500, encoding='16UC1'):
    data = np.full((4, 6), millimetres, '<u2').tobytes()
    message = Image(height=4, width=6, encoding=encoding, step=12, data=data)
    message.header.stamp = stamp_from_ns(stamp_ns)
    return message


@pytest.fixture
def heard(monkeypatch):
    """Return depth images that hear what the test says, and what says it."""
    subscription = Mock()
    subscription.return_value.topic = '/depth'
    monkeypatch.setattr(module, 'FollowingSubscription', subscription)
    images = module.DepthImages(Mock(), '/depth', 0.001, ReadingConfig())
    return images, subscription.call_args.args[3]


def test_a_frame_gets_the_depth_of_its_moment(heard):
    images, hear = heard
    assert images.at(SECOND) is None and images.missing == 0
    hear(depth(SECOND, 1500))
    hear(depth(SECOND + 100 * MS, 1600))
    assert images.at(SECOND + 5 * MS)[0, 0] == pytest.approx(1.5)
    assert images.at(SECOND + 98 * MS)[0, 0] == pytest.approx(1.6)
    assert images.at(SECOND + 50 * MS) is None and images.missing == 1


def test_a_frame_waits_for_its_depth_but_not_for_ever(heard):
    images, hear = heard
    hear(depth(SECOND))
    for _ in range(4):
        assert images.at(2 * SECOND) is None
    images.waiting.wait_s = 3600.0
    assert images.at(2 * SECOND) is None  # three waited in vain: none waits
    hear(depth(SECOND + 100 * MS))
    found = []
    waiting = threading.Thread(target=lambda: found.append(images.at(SECOND + 200 * MS)))
    waiting.start()
    hear(depth(SECOND + 200 * MS, 1700))
    waiting.join(10)
    assert found[0][0, 0] == pytest.approx(1.7)


def test_what_is_no_depth_is_counted(heard):
    images, hear = heard
    hear(depth(SECOND, encoding='rgb8'))
    assert images.at(SECOND) is None and images.unreadable == 1


def test_without_a_topic_nothing_is_heard():
    images = module.DepthImages(Mock(), '', 1.0, ReadingConfig())
    assert images.at(SECOND) is None and images.missing == 0
