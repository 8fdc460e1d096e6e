# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Arrays that grow while they are read."""

from convseq_ros.core.map.place import GrowingArray
import numpy as np
import pytest


@pytest.mark.parametrize('start', [0, 3, 64])
def test_rows_come_after_those_that_were_there(start):
    first = np.arange(start * 2.0).reshape(start, 2)
    growing = GrowingArray(first)
    for number in range(200):
        growing.extend([(number, -number)])
    assert len(growing) == start + 200
    assert (growing.view[:start] == first).all()
    assert (growing.view[start:, 1] == -np.arange(200)).all()


def test_a_view_stays_as_it_was():
    growing = GrowingArray(np.zeros(0))
    growing.extend([1])
    before = growing.view
    for number in range(500):
        growing.extend([number])
    assert before.tolist() == [1]


def test_little_is_copied():
    growing, moved = GrowingArray(np.zeros(0)), 0
    for number in range(10_000):
        room = growing._rows
        growing.extend([number])
        moved += growing._rows is not room
    assert moved < 40
