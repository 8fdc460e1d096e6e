# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The worker's queue is bounded in length and time, its order kept, its end prompt."""

import threading
from types import SimpleNamespace
import weakref

from convseq_ros.node.services.worker import Worker
from programs import wait_for
import pytest

LIMIT_S = 10


@pytest.fixture
def gate():
    """Return an event that every item waits for; set at the end so that no thread is left."""
    event = threading.Event()
    yield event
    event.set()


@pytest.fixture
def busy(gate):
    """Return a maker of a worker that holds a first item until the gate opens, and what it had."""
    workers = []

    def make(*limits, size=0, **more):
        handled = []

        def handle(item):
            handled.append(item)
            gate.wait()

        workers.append(worker := Worker(handle, *limits, **more))
        worker.start()
        worker.put(0, size)
        wait_for(lambda: handled == [0])
        return worker, handled

    yield make
    gate.set()
    assert all(worker.stop(LIMIT_S) for worker in workers)


def test_the_queue_is_bounded_in_bytes_and_keeps_the_newest_item(busy, gate):
    worker, handled = busy(100, queue_bytes=10, size=1000)
    for item in range(1, 6):
        worker.put(item, 4)
    assert (worker.waiting, worker.dropped) == (2, 3)
    worker.put(6, 1000)
    assert (worker.waiting, worker.dropped) == (1, 5)
    gate.set()
    wait_for(lambda: len(handled) == 2)
    assert handled == [0, 6]
    # What was taken holds no room any more.
    gate.clear()
    worker.put(7, 4)
    wait_for(lambda: handled[-1] == 7)
    worker.put(8, 5)
    worker.put(9, 5)
    assert worker.waiting == 2


def test_the_oldest_items_are_dropped_and_counted(busy, gate):
    worker, handled = busy(3)
    for item in range(1, 8):
        worker.put(item)
    assert (worker.waiting, worker.dropped) == (3, 4)
    gate.set()
    wait_for(lambda: len(handled) == 4)
    assert handled == [0, 5, 6, 7]


@pytest.fixture
def clock(monkeypatch):
    """Return a clock for the worker that the test sets, in milliseconds."""
    now = SimpleNamespace(ms=0.0)
    watch = SimpleNamespace(monotonic_ns=lambda: round(now.ms * 1e6))
    monkeypatch.setattr('convseq_ros.node.services.worker.time', watch)
    return now


def test_frames_that_wait_too_long_are_dropped_evenly(clock):
    """Three items come while one is handled; what is handled waited as long as is allowed."""
    made_ms, handled = [], []

    def come():
        made_ms.append(clock.ms)
        worker.put(len(made_ms) - 1)

    def handle(item):
        handled.append((item, clock.ms - made_ms[item]))
        for _ in range(3):
            clock.ms += 10
            if len(made_ms) < 150:
                come()

    worker = Worker(handle, 1000, max_wait_s=0.2)
    come()
    worker.start()
    wait_for(lambda: len(handled) + worker.dropped == 150)
    assert worker.stop(LIMIT_S)
    assert worker.dropped > 75
    # The first wait longer and longer; then two of three give way; the last has none behind it.
    assert handled == [
        *((item, 20 * item) for item in range(11)),
        *((item, 200) for item in range(13, 149, 3)),
        (149, 220),
    ]
    assert worker.dropped == 150 - len(handled)


def test_the_newest_item_is_handled_however_long_it_waited(busy, gate, clock):
    worker, handled = busy(3, max_wait_s=0.01)
    worker.put(1)
    worker.put(2)
    clock.ms = 50
    gate.set()
    wait_for(lambda: len(handled) == 2)
    assert handled == [0, 2] and worker.dropped == 1


def test_an_action_comes_after_the_item_at_hand_and_before_the_next(busy, gate):
    worker, handled = busy(3)
    worker.put('second')
    worker.between_items(lambda: handled.append('action'))
    gate.set()
    wait_for(lambda: len(handled) == 3)
    assert handled == [0, 'action', 'second']


def test_stopping_finishes_the_item_at_hand_leaves_the_rest_and_ends_with_the_last_action(
    busy, gate
):
    ended = threading.Event()
    worker, handled = busy(9, at_end=ended.set)
    for item in range(4):
        worker.put(item)
    assert worker.waiting == 4
    assert not worker.stop(0.01) and not ended.is_set()
    gate.set()
    assert ended.wait(LIMIT_S)  # though nobody waits for the worker
    assert worker.stop(LIMIT_S) and handled == [0]


def test_a_worker_that_waits_keeps_no_item_alive():
    item = threading.Event()  # something that can be referred to weakly
    gone, handled = weakref.ref(item), []
    worker = Worker(lambda _: handled.append(1), 3)
    worker.put(item)
    del item
    worker.start()
    wait_for(lambda: handled and gone() is None)
    assert worker.stop(LIMIT_S)
