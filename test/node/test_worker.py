# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The worker's queue is bounded in length and time, its order kept, its end prompt."""

import threading
import time

import numpy as np
import pytest

pytest.importorskip('rclpy')

from convseq_ros.node.worker import Worker

LIMIT_S = 10


@pytest.fixture
def gate():
    """Return an event that every item waits for; set at the end so that no thread is left."""
    event = threading.Event()
    yield event
    event.set()


def settled(condition):
    deadline_s = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < deadline_s
        time.sleep(0.001)


def test_items_are_handled_in_order():
    handled = []
    worker = Worker(handled.append, 100)
    worker.start()
    for item in range(100):
        worker.put(item)
    settled(lambda: len(handled) == 100)
    assert handled == list(range(100))
    assert worker.stop(LIMIT_S)


def test_the_oldest_items_are_dropped_and_counted(gate):
    handled = []

    def handle(item):
        handled.append(item)
        gate.wait()

    worker = Worker(handle, 3)
    worker.start()
    worker.put(0)
    settled(lambda: handled == [0])
    for item in range(1, 8):
        worker.put(item)
    assert (worker.waiting, worker.dropped) == (3, 4)
    gate.set()
    settled(lambda: len(handled) == 4)
    assert handled == [0, 5, 6, 7]
    assert worker.stop(LIMIT_S)


def test_what_waits_for_too_long_gives_way_to_what_follows_evenly():
    """Three items come while one is handled; what is handled is never much older than asked."""
    made, waits = [], []

    def handle(item):
        waits.append(time.monotonic() - made[item])
        time.sleep(0.03)

    worker = Worker(handle, 1000, max_wait_s=0.2)
    worker.start()
    for item in range(150):
        made.append(time.monotonic())
        worker.put(item)
        time.sleep(0.01)
    settled(lambda: not worker.waiting)
    assert worker.stop(LIMIT_S)
    assert worker.dropped == 150 - len(waits) > 30
    assert np.median(waits[len(waits) // 2 :]) < 0.25


def test_the_newest_item_is_handled_however_long_it_waited(gate):
    handled = []

    def handle(item):
        handled.append(item)
        gate.wait()

    worker = Worker(handle, 3, max_wait_s=0.01)
    worker.start()
    worker.put(0)
    settled(lambda: handled == [0])
    worker.put(1)
    worker.put(2)
    time.sleep(0.05)
    gate.set()
    settled(lambda: len(handled) == 2)
    assert handled == [0, 2] and worker.dropped == 1
    assert worker.stop(LIMIT_S)


def test_an_action_comes_after_the_item_at_hand_and_before_the_next(gate):
    done = []

    def handle(item):
        gate.wait()
        done.append(item)

    worker = Worker(handle, 3)
    worker.start()
    worker.put('first')
    settled(lambda: worker.waiting == 0)
    worker.put('second')
    worker.between_items(lambda: done.append('action'))
    gate.set()
    settled(lambda: len(done) == 3)
    assert done == ['first', 'action', 'second']
    assert worker.stop(LIMIT_S)


def test_stopping_finishes_the_item_at_hand_and_leaves_the_rest(gate):
    done = []

    def handle(item):
        gate.wait()
        done.append(item)

    worker = Worker(handle, 9)
    worker.start()
    for item in range(5):
        worker.put(item)
    settled(lambda: worker.waiting == 4)
    assert not worker.stop(0.01)
    gate.set()
    assert worker.stop(LIMIT_S)
    assert done == [0]


def test_a_worker_that_never_started_stops():
    assert Worker(print, 1).stop(LIMIT_S)
