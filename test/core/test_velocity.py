# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Drives at another velocity than the map's."""

from importlib import import_module

from convseq_ros.core.compiled import available
from convseq_ros.core.map.sessions import SessionBounds
from convseq_ros.core.sequence.diagonals import diagonal, sequence_scores
from convseq_ros.core.sequence.velocity import VELOCITY, VelocitySearch
from hypothesis import given, strategies
import numpy as np
import pytest

FRAMES, REFERENCES, K = 60, 400, 10
BOTH = sorted([*VELOCITY.velocities, *(-one for one in VELOCITY.velocities)])
KERNELS = ['numpy_kernels', *(['kernels'] if available() else [])]


def rows_at(velocity, seed=0):
    """Return a row a frame of noise in which the true place stands out."""
    rng = np.random.default_rng(seed)
    scores = rng.normal(0.1, 0.02, (FRAMES, REFERENCES)).astype(np.float32)
    for frame in range(FRAMES):
        true = (5 if velocity > 0 else REFERENCES - 6) + round(frame * velocity)
        if 0 <= true < REFERENCES:
            scores[frame, true] += 0.2
    return list(scores)


def found_in(rows, both=False):
    search = VelocitySearch(both=both)
    return [search.update(rows[index - K + 1 : index + 1][::-1]) for index in range(K, FRAMES)]


@pytest.mark.parametrize('velocity', sorted(VELOCITY.velocities))
def test_the_velocity_of_the_drive_is_found(velocity):
    found = found_in(rows_at(velocity))
    assert found[-1] == pytest.approx(velocity, rel=0.1, abs=0.08)


@pytest.mark.parametrize('velocity', BOTH[::3])
def test_the_velocity_is_found_in_both_directions(velocity):
    found = found_in(rows_at(velocity), both=True)
    assert found[-1] == pytest.approx(velocity, rel=0.1, abs=0.2)


def test_a_drive_backwards_is_not_looked_for_unless_asked():
    assert min(found_in(rows_at(-1.0))) > 0


def test_one_to_one_is_kept_where_other_velocities_stand_out_hardly_more():
    rows = rows_at(1.0)
    for frame, row in enumerate(rows):
        row[min(REFERENCES - 1, 60 + round(frame * 0.8))] += 0.2
    assert set(found_in(rows)) == {1.0}


def closely(best):
    """Return what pair scores say: sequences of one velocity stand out."""
    return lambda velocity: np.array([0.3 if velocity == best else 0.11, 0.1, 0.1])


def test_a_velocity_that_is_seen_competes_by_pair_scores_and_stays_while_it_wins():
    dark = np.random.default_rng(0).normal(0.1, 0.02, (K, REFERENCES)).astype(np.float32)
    search, rows = VelocitySearch(), list(dark)[: VELOCITY.shortest - 1]
    assert search.update(rows, closely(6.0)) == 1.0  # nobody has asked
    assert search.update(rows, closely(1.0), seen=5.8) == 1.0
    for _ in range(10):
        found = search.update(rows, closely(6.0), seen=5.8)
    assert found == search.update(rows, closely(6.0)) == 6.0
    for _ in range(30):
        found = search.update(rows, closely(1.0))
    assert found == 1.0


@pytest.mark.parametrize('seen', [-6.0, 20.0])
def test_a_velocity_that_is_not_searched_is_not_asked_for(seen):
    asked = []
    search, rows = VelocitySearch(), [np.full(REFERENCES, 0.1, np.float32)]
    assert search.update(rows, lambda one: asked.append(one) or np.ones(1), seen=seen) == 1.0
    assert asked == []


@pytest.mark.parametrize('velocity', [1.0, 2.0])
@pytest.mark.parametrize('seed', range(5))
def test_frames_of_unknown_streets_are_soon_outvoted(velocity, seed):
    unknown, soon = 40, 4
    rows = list(np.random.default_rng(seed).normal(0.1, 0.02, (70, 200)).astype(np.float32))
    for frame, row in enumerate(rows):
        known = frame - unknown
        place, height = (20 + 1.5 * frame, 0.05) if known < 0 else (60 + velocity * known, 0.2)
        row[round(place)] += height
    search = VelocitySearch()
    found = [search.update(rows[index - K + 1 : index + 1][::-1]) for index in range(K, 70)]
    assert 1.5 in found[: unknown - K]
    assert found[unknown - K + soon :] == pytest.approx([velocity] * (30 - soon), abs=0.26)


def test_short_sequences_tell_no_velocity():
    search, rows = VelocitySearch(), rows_at(2.0)
    assert {search.update(rows[index - 4 : index][::-1]) for index in range(10, 50)} == {1.0}


def test_unknown_pairs_and_frames_do_not_change_the_velocity():
    rows = rows_at(1.5)
    for row in rows:
        row[[3, 77]] = np.nan
    search = VelocitySearch()
    for index in range(K, FRAMES):
        window = rows[index - K + 1 : index + 1][::-1]
        window[3] = None
        found = search.update(window)
    assert found == 1.5


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
@given(rows=DRAWN, bounds=SESSIONS)
def test_peaks_are_those_of_sequence_scores(kernels, rows, bounds):
    steps, own = np.array([diagonal(len(rows), one) for one in BOTH]), bounds.starts
    found = import_module(f'convseq_ros.core.sequence.{kernels}').peaks(rows, steps, own)
    for velocity, (highest, mean, number) in zip(BOTH, found, strict=True):
        scores = sequence_scores(rows, velocity, bounds=bounds)
        scores = scores[np.isfinite(scores)]
        assert number == scores.size
        if scores.size:
            assert (highest, mean) == pytest.approx((scores.max(), scores.mean()), abs=1e-5)


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


def test_a_new_drive_starts_anew():
    search, rows = VelocitySearch(), rows_at(2.0)
    for index in range(K, 40):
        search.update(rows[index - K + 1 : index + 1][::-1])
    search.reset()
    rows = rows_at(1.0)
    assert search.update(rows[:K][::-1]) == 1.0


def test_a_diagonal_of_velocity_two_meets_every_second_reference():
    assert diagonal(4, 2.0) == [0, 2, 4, 6]
    assert diagonal(5, 0.5) == [0, 1, 1, 2, 2]


def test_a_diagonal_of_a_drive_backwards_is_the_same_on_the_other_side():
    assert diagonal(4, -2.0) == [0, -2, -4, -6]
    assert diagonal(5, -0.5) == [0, -1, -1, -2, -2]


@given(rows=DRAWN, velocity=strategies.sampled_from(VELOCITY.velocities), bounds=SESSIONS)
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
