# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The log says what was done, and what was dropped and why."""

from convseq_ros.node import diagnostics as progress_log
import pytest
from sensor_msgs.msg import Image

SECOND = 1_000_000_000


@pytest.fixture
def quick(monkeypatch):
    """Have the log looked after often."""
    monkeypatch.setattr(progress_log, '_LOOK_S', 0.05)
    monkeypatch.setattr(progress_log, '_PERIOD_S', 0.1)


@pytest.fixture
def told(monkeypatch):
    """Return what is logged, with its level."""
    lines = []

    class Logger:
        def info(self, text, **_):
            lines.append(('info', text))

        def warning(self, text, **_):
            lines.append(('warning', text))

        error = warning

    monkeypatch.setattr(progress_log.Node, 'get_logger', lambda _: Logger())
    return lines


def test_drops_are_told_with_their_cause_and_the_end_sums_up(
    quick, told, client, vpr, street, image, map_path, held
):
    node = vpr(map_path=map_path, queue_size=2)
    camera = client.camera(Image)
    for index in range(8):
        camera.publish(image(street[index], index * SECOND + 1))
        # The middleware holds no more than the queue does.
        client.wait_for(lambda index=index: node._statistics.received == index + 1)
    # One is held, two wait.
    client.wait_for(lambda: node._worker.dropped == 5)

    def warned():
        return [text for level, text in told if level == 'warning' and 'dropped' in text]

    (first, *_) = client.wait_for(warned)
    assert 'frames dropped' in first and 'found the queue full (queue_size)' in first
    held.set()
    client.wait_for(lambda: node._statistics.processed == 3)
    client.wait_for(lambda: any(level == 'info' and 'frames came' in text for level, text in told))
    node.context.try_shutdown()
    client.wait_for(lambda: told[-1][1].startswith('at the end: 8 frames came, 3 processed'))
    assert '5 dropped since the start' in told[-1][1]


def test_a_node_that_saw_nothing_says_nothing_of_it(quick, told, vpr, map_path, client):
    node = vpr(map_path=map_path)
    client.wait_for(lambda: node._ready)
    node.context.try_shutdown()
    client.wait_for(lambda: not node._worker._thread.is_alive())
    assert not any('frames' in text for _, text in told)
