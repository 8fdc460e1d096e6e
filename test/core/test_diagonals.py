# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sequence scores at another velocity than the map's, whole and partial."""

from importlib import import_module

from convseq_ros.core.compiled import available
from convseq_ros.core.decision.motion import MOTION
from convseq_ros.core.map.sessions import SessionBounds
from convseq_ros.core.sequence.diagonals import diagonal, sequence_scores
from hypothesis import given, strategies
import numpy as np
import pytest

AHEAD = tuple(one for one in MOTION.velocities if one)
BOTH = sorted([*AHEAD, *(-one for one in AHEAD)])
KERNELS = ['numpy_kernels', *(['kernels'] if available() else [])]


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


DRAWN = strategies.builds(
    windows,
    strategies.integers(1, 1100),
    strategies.integers(1, 20),
    strategies.floats(0, 0.9),
    strategies.integers(0, 99),
)


SESSIONS = strategies.builds(
    lambda starts: SessionBounds(tuple(sorted(starts))),
    strategies.sets(strategies.integers(1, 1200), max_size=6),
)


@pytest.mark.parametrize('kernels', KERNELS)
@given(rows=DRAWN, velocity=strategies.sampled_from(BOTH), bounds=SESSIONS)
def test_whole_scores_are_those_of_every_end(kernels, rows, velocity, bounds):
    steps, ends = np.array(diagonal(len(rows), velocity)), np.arange(len(rows[0]))
    module = import_module(f'convseq_ros.core.sequence.{kernels}')
    found = module.whole_scores(rows, steps, bounds.starts)
    # All but one of the ends are scored pair by pair.
    for some in (ends[1:], ends[:-1]):
        scores = sequence_scores(rows, velocity, some, bounds=bounds)
        assert found[some] == pytest.approx(scores, abs=1e-5)


@pytest.mark.parametrize('kernels', KERNELS)
@given(rows=DRAWN, velocity=strategies.sampled_from(BOTH), bounds=SESSIONS)
def test_partial_scores_count_unknown_pairs_as_the_mean_of_their_row(
    kernels, rows, velocity, bounds
):
    steps, own = np.array(diagonal(len(rows), velocity)), bounds.starts
    found = import_module(f'convseq_ros.core.sequence.{kernels}').partial_scores(rows, steps, own)
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


def test_a_diagonal_of_velocity_two_meets_every_second_reference():
    assert diagonal(4, 2.0) == [0, 2, 4, 6]
    assert diagonal(5, 0.5) == [0, 1, 1, 2, 2]


def test_a_diagonal_of_a_drive_backwards_is_the_same_on_the_other_side():
    assert diagonal(4, -2.0) == [0, -2, -4, -6]
    assert diagonal(5, -0.5) == [0, -1, -1, -2, -2]


@given(rows=DRAWN, velocity=strategies.sampled_from(AHEAD), bounds=SESSIONS)
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


def test_hand_worked_score_backwards():
    newest = np.array([0.9, 0.1, 0, 0], np.float32)
    older = np.array([0, 0, 0.7, 0.3], np.float32)
    scores = sequence_scores([newest, older], velocity=-2.0)
    assert scores[:2] == pytest.approx([(0.9 + 0.7) / 2, (0.1 + 0.3) / 2])
    assert scores[2:].tolist() == [-np.inf, -np.inf]


def test_hand_worked_score_at_velocity_two():
    newest = np.array([0, 0, 0.9, 0.1], np.float32)
    older = np.array([0.7, 0.3, 0, 0], np.float32)
    scores = sequence_scores([newest, older], velocity=2.0)
    assert scores[:2].tolist() == [-np.inf, -np.inf]
    assert scores[2:] == pytest.approx([(0.9 + 0.7) / 2, (0.1 + 0.3) / 2])
