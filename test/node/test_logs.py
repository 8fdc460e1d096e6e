# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The log says what was done and dropped; the result file may fail, and the node goes on."""

import errno
from unittest.mock import Mock

from convseq_ros.core.types import Match, Reason, Status
from convseq_ros.node import progress_log
from convseq_ros.node.recognition import ResultLog
from convseq_ros.results import read_results, ResultWriter
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


def match(index):
    return Match(index, index, Status.SKIPPED, Reason.WARMING_UP)


def test_a_full_disk_is_told_once_and_counted(tmp_path, monkeypatch):
    logger = Mock()
    log = ResultLog(str(tmp_path / 'result.csv'), logger)
    log.write(match(0), 1.5)
    full = OSError(errno.ENOSPC, 'No space left on device')
    with monkeypatch.context() as patch:
        patch.setattr(ResultWriter, 'write', Mock(side_effect=full))
        log.write(match(1), 1.5)
        log.write(match(2), 1.5)
    log.write(match(3), 1.5)
    log.close()
    assert log.lost == 3
    logger.error.assert_called_once()
    assert 'No space left on device' in logger.error.call_args.args[0]
    assert len(read_results(tmp_path / 'result.csv.part')) == 1
