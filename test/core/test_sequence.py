# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sequence length, and sequence scores at any velocity, whole and partial."""

from unittest.mock import patch

from convseq_ros.config import SequenceConfig
from convseq_ros.core.compiled import available
from convseq_ros.core.decision.motion import MOTION
from convseq_ros.core.map.sessions import SessionBounds
from convseq_ros.core.sequence import diagonals
from convseq_ros.core.sequence.diagonals import diagonal, sequence_scores
from convseq_ros.core.sequence.length import choose_length
from convseq_ros.core.types import Descriptor
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from test.golden.restatement import length_at

RULE = SequenceConfig()
# Runs of frames that let a sequence grow, or just not.
RUN = st.tuples(st.sampled_from([0.0, 0.4, 0.6, 0.89, 0.9, 1.0]), st.integers(1, 30))
RUNS = st.lists(RUN, max_size=3).map(
    lambda runs: [one for one, count in runs for _ in range(count)]
)


def frame(entropy=0.6, informative=True):
    cells = np.full((2, 2, 8), informative, np.float32)
    return Descriptor(cells, np.array([informative]), np.zeros((2, 2)), entropy)


def length(frames, similar, config=RULE):
    """Choose k where the i-th frame outward has the i-th similarity to the anchor."""
    by_identity = {id(each): value for each, value in zip(frames, similar, strict=True)}
    return choose_length(frames, lambda _, other, _least: by_identity[id(other)], config)


def frames(count, entropy=0.6):
    return [frame(entropy) for _ in range(count)]


@given(RUNS, RUNS)
def test_lengths_are_those_of_the_paper_restated(similar, entropies):
    similar, entropies = [1.0, *similar], [0.6, *entropies]
    newest = min(len(similar), len(entropies)) - 1
    similar, entropies = similar[: newest + 1], entropies[: newest + 1]
    # The restatement has the newest frame last.
    expected = length_at(newest, {newest: similar[::-1]}, entropies[::-1])
    assert length([frame(value) for value in entropies], similar) == expected


def test_fixed_length_ignores_similarity_and_entropy():
    fixed = SequenceConfig(fixed_length=10)
    assert length(frames(9), [1] * 9, fixed) is None
    assert length(frames(30, 0.1), [1] * 30, fixed) == 10


def test_uninformative_frames_are_passed_over():
    mixed = [frame(), frame(0.0, informative=False), frame(), frame()]
    assert length(mixed, [1, 0.0, 0.5, 1]) == 3


@pytest.mark.parametrize('velocity', [0.5, 1.0, 2.0])
@given(data=st.data())
def test_chosen_ends_have_the_scores_that_they_have_among_all(data, velocity):
    rows = drawn_rows(data)
    count = len(rows[0])
    ends = np.array(sorted(data.draw(st.sets(st.integers(0, count - 1)))), np.int64)
    whole = sequence_scores(rows, velocity)
    assert sequence_scores(rows, velocity, ends) == pytest.approx(whole[ends], abs=1e-6)
    assert whole.shape == (count,)


@pytest.mark.parametrize('velocity', [0.5, 1.0, 2.0])
@given(data=st.data())
def test_scores_are_those_of_the_definition(data, velocity):
    rows, expected = drawn_rows(data), []
    for end in range(len(rows[0])):
        met = [end - int(offset * velocity + 0.5) for offset in range(len(rows))]
        pairs = [
            row[index] if row is not None and 0 <= index < len(row) else np.nan
            for row, index in zip(rows, met, strict=True)
        ]
        known = np.isfinite(pairs)
        fits = known[0] and 0 <= met[-1] < len(rows[0]) and 2 * known.sum() >= len(rows)
        expected.append(np.mean(np.array(pairs, float)[known]) if fits else -np.inf)
    assert sequence_scores(rows, velocity) == pytest.approx(expected)


def drawn_rows(data):
    """Draw rows, some of them shorter than the newest, None, or with unknown pairs."""
    rng = np.random.default_rng(data.draw(st.integers(0, 999)))
    count = data.draw(st.integers(1, 30))
    rows = [rng.random(count, np.float32)]
    for _ in range(data.draw(st.integers(0, 6))):
        row = rng.random(int(rng.integers(0, count + 1)) if rng.random() < 0.3 else count)
        rows.append(None if rng.random() < 0.2 else row.astype(np.float32))
    for row in rows:
        if row is not None and rng.random() < 0.4:
            row[rng.random(len(row)) < 0.4] = np.nan
    return rows


AHEAD = tuple(one for one in MOTION.velocities if one)

BOTH = sorted([*AHEAD, *(-one for one in AHEAD)])

COMPILED = [False, True] if available() else [False]


def windows(count, length, unknown, seed):
    """Return whole rows, shorter ones, missing ones and unknown pairs."""
    rng = np.random.default_rng(seed)
    counts = rng.integers(max(1, count - 2), count + 1, length)
    rows = [rng.random(one, np.float32) - 0.2 for one in counts]
    rows[0] = rng.random(count, np.float32)
    for row in rows[1::2]:
        row[rng.random(len(row)) < unknown] = np.nan
    rows[2::5] = [None] * len(rows[2::5])
    return rows


DRAWN = st.builds(
    windows, st.integers(1, 1100), st.integers(1, 20), st.floats(0, 0.9), st.integers(0, 99)
)

SESSIONS = st.builds(
    lambda starts: SessionBounds(tuple(sorted(starts))), st.sets(st.integers(1, 1200), max_size=6)
)


@pytest.mark.parametrize('compiled', COMPILED)
@given(rows=DRAWN, velocity=st.sampled_from(BOTH), bounds=SESSIONS)
def test_whole_scores_are_those_of_every_end(compiled, rows, velocity, bounds):
    ends = np.arange(len(rows[0]))
    with patch.object(diagonals, 'available', lambda: compiled):
        found = sequence_scores(rows, velocity, bounds=bounds)
    # All but one of the ends are scored pair by pair.
    for some in (ends[1:], ends[:-1]):
        scores = sequence_scores(rows, velocity, some, bounds=bounds)
        assert found[some] == pytest.approx(scores, abs=1e-5)


@pytest.mark.parametrize('compiled', COMPILED)
@given(rows=DRAWN, velocity=st.sampled_from(BOTH), bounds=SESSIONS)
def test_partial_scores_count_unknown_pairs_as_the_mean_of_their_row(
    compiled, rows, velocity, bounds
):
    steps = diagonal(len(rows), velocity)
    with patch.object(diagonals, 'available', lambda: compiled):
        found = sequence_scores(rows, velocity, partial=True, bounds=bounds)
    shown = [(row, step) for row, step in zip(rows, steps, strict=True) if row is not None]
    for end in range(0, len(rows[0]), 1 + len(rows[0]) // 40):
        first, stop = bounds.span(end)
        pairs = [
            row[end - step] if first <= end - step < min(stop, len(row)) else np.nan
            for row, step in shown
        ]
        known = np.isfinite(pairs)
        if 2 * known.sum() < len(rows):
            assert found[end] == -np.inf
            continue
        means = [np.nanmean(row) if np.isfinite(row).any() else 0 for row, _ in shown]
        assert found[end] == pytest.approx(np.where(known, pairs, means).mean(), abs=1e-5)


def test_a_diagonal_meets_a_reference_for_each_frame_ahead_or_backwards():
    assert diagonal(4, 2.0) == [0, 2, 4, 6] and diagonal(4, -2.0) == [0, -2, -4, -6]
    assert diagonal(5, 0.5) == [0, 1, 1, 2, 2] and diagonal(5, -0.5) == [0, -1, -1, -2, -2]


@given(rows=DRAWN, velocity=st.sampled_from(AHEAD), bounds=SESSIONS)
def test_backwards_scores_are_those_ahead_in_the_map_read_from_its_end(rows, velocity, bounds):
    count = len(rows[0])
    starts = [count - one for one in bounds.starts.tolist() if 0 < one < count]
    mirrored = [None if row is None else np.full(count, np.nan, np.float32) for row in rows]
    for row, other in zip(rows, mirrored, strict=True):
        if row is not None:
            other[count - len(row) :] = row[::-1]
    ahead = sequence_scores(
        mirrored, velocity, bounds=SessionBounds(tuple(sorted(starts))), partial=False
    )
    found = sequence_scores(rows, -velocity, bounds=bounds)
    np.testing.assert_array_equal(found, ahead[::-1])
