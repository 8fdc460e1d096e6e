# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The frame gate: in which order frames come, and which of them are keyframes."""

from convseq_ros.config import Config, EVERY_FRAME, KeyframeConfig
from convseq_ros.core.frame_gate import FrameGate, Order, StampOrder
from convseq_ros.core.similarity.paper_similarity import PaperSimilarity
from convseq_ros.core.types import Pose, Reason
import pytest

STEP_NS = 100_000_000
SECOND = 10**9


def test_stamps_are_next_late_or_of_a_clock_that_jumped_back():
    order = StampOrder()
    stamps = [5 * SECOND, 5 * SECOND, 4 * SECOND, 6 * SECOND, 5 * SECOND, 5 * SECOND - 1]
    late, jumped = Order.LATE, Order.JUMPED_BACK
    expected = [Order.NEXT, Order.NEXT, late, Order.NEXT, late, jumped]
    assert [order.update(stamp_ns) for stamp_ns in stamps] == expected
    assert order.update(5 * SECOND - 2) is late
    order.reset()
    assert order.update(0) is Order.NEXT


def at(place):
    return Pose((float(place), 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


@pytest.fixture
def verdicts(described):
    """Return what a gate says of places, one a step; None is a frame that never comes."""

    def say(places, keyframes=EVERY_FRAME, encode=None):
        gate = FrameGate(Config(), keyframes, PaperSimilarity())
        descriptor = described(0)
        return [
            gate.update(index * STEP_NS, at(place), encode or (lambda: descriptor))
            for index, place in enumerate(places)
            if place is not None
        ]

    return say


def test_frames_while_the_robot_stands_are_no_keyframes(verdicts):
    found = verdicts([0, 1, 2, 2, 2, 3])
    still = Reason.STATIONARY
    assert [one.reason for one in found] == [None, None, None, still, still, None]


def test_frames_between_keyframes_are_not_described(verdicts, described):
    asked = []

    def encode():
        asked.append(True)
        return described(0)

    found = verdicts(range(9), KeyframeConfig(keyframe_interval_s=0.3, keyframe_overlap=1), encode)
    between = Reason.BETWEEN_KEYFRAMES
    assert [one.reason for one in found] == [None, between, between] * 3
    assert len(asked) == 3
    assert [one.descriptor.informative for one in found] == [True, False, False] * 3


def test_dropped_keyframes_are_counted_also_soon_after_a_stop(verdicts):
    found = verdicts([*range(12), *[11] * 6, 12, None, 14, None, None, 17, 18])
    keyframes = [one.missing for one in found if one.reason is None]
    assert keyframes == [0] * 13 + [1, 2, 0]


def test_a_gate_that_was_reset_begins_with_a_keyframe(described):
    gate = FrameGate(Config(), EVERY_FRAME, PaperSimilarity())

    def shown():
        return gate.update(0, at(0), lambda: described(0)).reason

    assert [shown(), shown()] == [None, Reason.STATIONARY]
    gate.reset()
    assert shown() is None
