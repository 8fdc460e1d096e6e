# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How new an image is, and how many frames carry the evidence."""

from types import SimpleNamespace

from convseq_ros.core.sequence.query_buffer import evidence_length, novelty, QueryBuffer
import numpy as np
import pytest

SHOWN = SimpleNamespace(informative=True)


@pytest.mark.parametrize(
    ('first', 'second', 'expected'),
    [
        ((4, 3), (4, 3), 0),
        ((4, 3), (5, 0), 0.4),
        ((3, 4), (5, 0), 0.8),
        ((0, 5), (5, 0), 1),
        ((-5, 0), (5, 0), 1),
        ((0, 0), (5, 0), 1),
    ],
)
def test_novelty_grows_to_one_as_the_cosine_falls_to_one_half(first, second, expected):
    rows = [np.array([one], np.int8) for one in (second, first)]
    features = [SimpleNamespace(packed=SimpleNamespace(rows=one)) for one in rows]
    buffer = QueryBuffer(SimpleNamespace(extract=lambda _: features.pop()))
    buffer.append(SHOWN, 3, 10)
    assert novelty(buffer.frames) == 1
    buffer.append(SHOWN, 3, 10)
    assert novelty(buffer.frames) == pytest.approx(expected)


@pytest.mark.parametrize(
    ('evidence', 'length'),  # newest first
    [
        ([5.0], 1),
        ([0.0, 0.0, 0.0], 1),
        ([9.0, 1.0, 0.0], 1),
        ([8.9, 1.0, 0.1], 2),
        ([1.0] * 10, 9),
        ([0.0, 0.0, 4.0, 1.0], 4),
        ([0.0, 0.0, 4.0, 0.4], 3),
        ([1.0] * 10 + [900.0], 9),  # the last one has left the buffer
    ],
)
def test_k_newest_frames_carry_nine_tenths_of_the_evidence(evidence, length):
    buffer = QueryBuffer(SimpleNamespace(extract=lambda _: None))
    for one in reversed(evidence):
        buffer.append(SHOWN, 3, 10)
        buffer.note(np.zeros(3, np.float32), one)
    assert evidence_length(buffer.frames) == length
