# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is heard too early is taken in later, in order."""

from unittest.mock import Mock

from convseq_ros.node.inputs.backlog import Backlog


def test_what_is_heard_waits_in_order_also_while_it_is_taken_in_and_then_nothing_does():
    taken, logger = [], Mock()
    backlog = Backlog(logger, True)

    def take(number):
        if number == 2:
            hear(4)  # comes meanwhile
            raise ValueError('no good')
        taken.append(number)

    hear, note = backlog.before(take, matters=True), backlog.before(taken.append)
    note(1)
    assert not backlog.since_s and not taken
    hear(2)
    began_s = backlog.since_s
    hear(3)
    assert backlog.since_s == began_s > 0 and backlog.is_waiting
    backlog.take_in()
    assert taken == [1, 3, 4] and not backlog.is_waiting and not backlog.since_s
    assert 'no good' in logger.error.call_args.args[0] and logger.error.call_count == 1
    note(5)
    assert taken[-1] == 5


def test_without_a_map_to_read_nothing_waits():
    taken, backlog = [], Backlog(Mock(), False)
    backlog.before(taken.append, matters=True)(1)
    assert taken == [1] and not backlog.is_waiting and not backlog.since_s
