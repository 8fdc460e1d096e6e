# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sequence length, sequence scores, and how many frames carry the evidence."""

from dataclasses import replace
from itertools import chain, count
from types import SimpleNamespace
from unittest.mock import Mock

from convseq_ros.config import EncodingConfig, SequenceConfig
from convseq_ros.core.decision.paper.length import choose_length
from convseq_ros.core.encoding.descriptor import blank_descriptor
from convseq_ros.core.graph.neighbourhood import SessionBounds
from convseq_ros.core.sequence.query_buffer import (
    BufferedFrame,
    diagonal,
    evidence_length,
    novelty,
    QueryBuffer,
    sequence_scores,
)
from convseq_ros.core.types import Descriptor
from golden.restatement import length_at
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

RULE = SequenceConfig()


def runs(*values):
    """Return runs of frames that let a sequence grow, or just not."""
    run = st.builds(lambda one, count: [one] * count, st.sampled_from(values), st.integers(1, 30))
    return st.lists(run, max_size=3).map(lambda some: [*chain.from_iterable(some)])


def frame(entropy=0.6, informative=True):
    cells = np.full((2, 2, 8), informative, np.float32)
    return Descriptor(cells, np.array([informative]), np.zeros((2, 2)), entropy)


def length(frames, similar, config=RULE):
    """Choose k where the i-th frame outward has the i-th similarity to the anchor."""
    by_identity = {id(each): value for each, value in zip(frames, similar, strict=True)}
    return choose_length(frames, lambda _, other: by_identity[id(other)], config)


# Sums of these entropies are exact, in whatever order.
@given(runs(0.0, 0.4, 0.89, 0.9, 1.0), runs(0.0, 0.375, 0.625, 1.0))
def test_lengths_are_those_of_the_paper_restated(similar, entropies):
    similar, entropies = [1.0, *similar], [0.625, *entropies]
    newest = min(len(similar), len(entropies)) - 1
    similar, entropies = similar[: newest + 1], entropies[: newest + 1]
    # The restatement has the newest frame last.
    expected = length_at(newest, {newest: similar[::-1]}, entropies[::-1])
    assert length([frame(value) for value in entropies], similar) == expected


BOUNDS = [  # number of frames, their entropy, similarities, settings, and the length
    (9, 0.6, [1] * 9, {'fixed_length': 10}, None),
    (30, 0.1, [1] * 30, {'fixed_length': 10}, 10),  # whatever similarity and entropy
    (30, 0.1, [1] * 30, {'max_length': 8}, 8),
    (30, 0.6, [1] * 30, {'max_length': 8}, 8),
    (30, 0.6, [0] * 30, {'min_length': 5}, 5),
    # A shortest length of one frame lets the next one decide.
    (9, 0.6, [1, 0.5] + [1] * 7, {'min_length': 1}, 1),
    (9, 0.6, [1, 1, 0.5] + [1] * 6, {'min_length': 1}, 3),
    (9, 0.1, [1, 0.5] + [1] * 7, {'min_length': 1, 'max_length': 4}, 4),
    (1, 0.6, [1], {'min_length': 1}, None),
    # It is unknown while the outermost frame overlaps the anchor.
    (4, 0.6, [1] * 4, {}, None),
    (4, 0.6, [1, 1, 1, 0.5], {}, 4),
]


@pytest.mark.parametrize(('count', 'entropy', 'similar', 'settings', 'expected'), BOUNDS)
def test_the_length_is_within_its_bounds(count, entropy, similar, settings, expected):
    frames = [frame(entropy) for _ in range(count)]
    assert length(frames, similar, SequenceConfig(**settings)) == expected


def test_uninformative_frames_are_passed_over():
    mixed = [frame(), frame(0.0, informative=False), frame(), frame()]
    assert length(mixed, [1, 0.0, 0.5, 1]) == 3


def windows(count, length, unknown, seed):
    """Return whole rows, shorter ones, missing ones and unknown pairs."""
    rng = np.random.default_rng(seed)
    counts = rng.integers(max(1, count - 2), count + 1, length)
    rows = [rng.random(one, np.float32) - 0.2 for one in counts]
    rows[0] = rng.random(count, np.float32)
    for row in rows[seed % 2 :: 2]:
        row[rng.random(len(row)) < unknown] = np.nan
    rows[2::5] = [None] * len(rows[2::5])
    return rows


DRAWN = st.builds(
    windows, st.integers(1, 1100), st.integers(1, 20), st.floats(0, 0.9), st.integers(0, 99)
)

SESSIONS = st.builds(
    lambda starts: SessionBounds(tuple(sorted(starts))), st.sets(st.integers(1, 1200), max_size=6)
)


def by_definition(rows, end, bounds):
    """Return what the diagonal that ends at a place scores, pair by pair."""
    first, stop = bounds.span(end)
    pairs = [
        row[end - age] if row is not None and first <= end - age < min(stop, len(row)) else None
        for age, row in enumerate(rows)
    ]
    pairs = np.array(pairs, float)
    known = np.isfinite(pairs)
    if not known[0] or 2 * known.sum() < len(rows):
        return -np.inf
    return pairs[known].mean() if end - len(rows) + 1 >= first else -np.inf


@given(rows=DRAWN, bounds=SESSIONS)
def test_scores_are_those_of_the_definition(rows, bounds):
    some = np.arange(0, len(rows[0]), 1 + len(rows[0]) // 40)
    expected = [by_definition(rows, end, bounds) for end in some.tolist()]
    found = sequence_scores(rows, bounds=bounds)
    assert found.shape == (len(rows[0]),)
    assert found[some] == pytest.approx(expected, abs=1e-5)
    # Ends that are chosen score what they score among all; sums of all are in single precision.
    assert sequence_scores(rows, some, bounds=bounds) == pytest.approx(expected, abs=1e-5)


def test_a_diagonal_has_one_reference_per_frame_at_each_velocity():
    assert diagonal(4, 2.0) == [0, 2, 4, 6] and diagonal(4, -2.0) == [0, -2, -4, -6]
    assert diagonal(5, 0.5) == [0, 1, 1, 2, 2] and diagonal(5, -0.5) == [0, -1, -1, -2, -2]


REFERENCES = 40
NOTHING = blank_descriptor(EncodingConfig())
SHOWN = replace(NOTHING, cells=NOTHING.cells + 1, salient=~NOTHING.salient)


class Given:
    """A matcher of given scores."""

    def __init__(self, scores):
        self._frames, self._scores = count(), scores

    def extract(self, _descriptor):
        return SimpleNamespace(frame=next(self._frames), packed=None)

    def scores_of(self, asked):
        return [self._scores[query.frame, indices] for query, indices in asked]


def filled(scores):
    matcher = Given(scores)
    buffer = QueryBuffer(matcher)
    for _ in range(len(scores)):
        buffer.append(SHOWN, REFERENCES, capacity=10)
        buffer.score(len(buffer), np.arange(REFERENCES))
    return matcher, buffer


def test_frames_can_be_compared_by_the_regions_of_the_newest():
    matcher, buffer = filled(drawn(5, 3))
    matcher.extract = Mock(return_value=SimpleNamespace(frame=1, packed=None))
    some = SHOWN.salient.copy()
    some[0] = False
    buffer.frames[0] = replace(buffer.newest, descriptor=replace(SHOWN, salient=some))
    buffer.frames.insert(1, BufferedFrame(NOTHING))
    shared = buffer.with_regions_of_newest(4)
    assert shared.newest is buffer.newest and len(shared) == 4
    # The empty slot stays empty; of the others, only regions of the newest are compared.
    asked = [one.args[0].salient for one in matcher.extract.mock_calls]
    assert len(asked) == 2 and (np.array(asked) == some).all()
    assert [frame.features is None for frame in shared.frames] == [False, True, False, False]
    assert np.isnan(shared.frames[2].row).all() and not np.isnan(buffer.frames[2].row).any()


def test_up_to_five_missing_frames_leave_gaps_and_more_empty_the_buffer():
    _, buffer = filled(drawn(0, 2))
    buffer.add_empty(5, NOTHING, 10)
    buffer.append(SHOWN, REFERENCES, 10)
    assert [row is None for row in buffer.rows] == [False, *[True] * 5, False, False]
    buffer.add_empty(6, NOTHING, 10)
    assert len(buffer) == 0


def drawn(seed, frames=1):
    return np.random.default_rng(seed).normal(0.1, 0.01, (frames, REFERENCES)).astype(np.float32)


@pytest.mark.parametrize('seed', range(20))
@pytest.mark.parametrize('frames', [1, 4])
def test_the_best_sequence_score_is_the_mean_of_a_diagonal(seed, frames):
    scores = drawn(seed, frames)
    _, buffer = filled(scores)
    found = buffer.best_scores(frames, np.arange(REFERENCES))
    ends = np.arange(frames - 1, REFERENCES)
    expected = np.mean([scores[frames - 1 - back, ends - back] for back in range(frames)], axis=0)
    assert found[: frames - 1].tolist() == [-np.inf] * (frames - 1)
    assert found.argmax() == ends[expected.argmax()]
    assert found.max() == pytest.approx(expected.max(), abs=1e-7)


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
