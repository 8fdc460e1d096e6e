# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`convseq watch` shows the last answer, the place and the counts."""

from contextlib import closing
import shutil
import signal
import sqlite3

import pytest

pytest.importorskip('rich')

from convseq_ros.core.map.reader import open_map
from convseq_ros.core.types import Candidate, Match, Reason, Status
from convseq_ros.node.conversions import answer_message
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.duration import Duration


def test_the_last_answer_is_shown_with_its_place_and_a_count_of_reasons(
    client, start, map_path, tmp_path
):
    publisher = client.node.create_publisher(DiagnosticArray, '/vpr_node/answer', 10)
    damaged = shutil.copy(map_path, tmp_path / 'damaged.db')
    with closing(sqlite3.connect(damaged)) as database, database:
        database.execute("UPDATE pictures SET thumbnail = x'00' WHERE reference_index = 7")
    watcher = start('watch', damaged)
    client.wait_for(publisher.get_subscription_count)
    client.wait_until_known_to('/convseq_watch')
    reference_map = open_map(map_path)
    weak = Match(3, 1, Status.REJECTED, Reason.WEAK, (Candidate(7, 1, 0.25),), 2, confidence=0.5)
    sure = Match(4, 2, Status.ACCEPTED, Reason.ACCEPTED, (Candidate(8, 1, 0.75),), 2, 0, 0.875)
    for match in (weak, weak, sure):
        publisher.publish(answer_message(match, 31.0, reference_map, 'map'))
    assert publisher.wait_for_all_acked(Duration(seconds=30))
    # Acknowledged is not shown yet: the executor takes one at a time, and the end shows all.
    watcher.send_signal(signal.SIGINT)
    text, errors = watcher.communicate(timeout=60)
    assert watcher.returncode == 0, errors
    assert 'frame' in text and '31 ms' in text
    assert '\u2580' * 20 in text


def test_a_map_that_is_missing_is_one_line(start, tmp_path):
    watcher = start('watch', tmp_path / 'none.db')
    _, errors = watcher.communicate(timeout=60)
    assert watcher.returncode == 1
    assert errors.startswith('convseq watch: ') and len(errors.splitlines()) == 1
