# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sequence length and sequence scores."""

from convseq_ros.config import SequenceConfig
from convseq_ros.core.sequence.diagonals import sequence_scores
from convseq_ros.core.sequence.length import choose_length
from convseq_ros.core.types import Descriptor
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

RULE = SequenceConfig()


def frame(entropy=0.6, informative=True):
    cells = np.full((2, 2, 8), informative, np.float32)
    return Descriptor(cells, np.array([informative]), np.zeros((2, 2)), entropy)


def length(frames, similar, config=RULE):
    """Choose k where the i-th frame outward has the i-th similarity to the anchor."""
    by_identity = {id(each): value for each, value in zip(frames, similar, strict=True)}
    return choose_length(frames, lambda _, other, _least: by_identity[id(other)], config)


def frames(count, entropy=0.6):
    return [frame(entropy) for _ in range(count)]


def test_sequence_stops_at_the_first_frame_that_brings_information_and_keeps_it():
    assert length(frames(6), [1, 0.95, 0.95, 0.89, 0.95, 0.95]) == 4


def test_shortest_chosen_sequence_is_two():
    assert length(frames(5), [1, 0.1, 1, 1, 1]) == 2


def test_similarity_at_the_threshold_still_grows_the_sequence():
    assert length(frames(4), [1, 0.9, 0.5, 1]) == 3


def test_similar_frames_grow_the_sequence_to_fifteen():
    assert length(frames(40), [1] * 40) == 15


def test_sequence_grows_while_entropy_is_low():
    low_then_high = frames(5, 0.4) + frames(20, 0.9)
    similar = [1, 0.1] + [1] * 23
    entropies = [each.entropy for each in low_then_high]
    expected = next(k for k in range(2, 25) if np.mean(entropies[:k]) > 0.5)
    assert length(low_then_high, similar) == expected == 7


def test_low_entropy_grows_the_sequence_to_twenty_five():
    assert length(frames(40, 0.2), [1, 0.1] + [1] * 38) == 25


def test_length_is_unknown_while_more_frames_would_be_needed():
    assert length(frames(1), [1]) is None
    assert length(frames(14), [1] * 14) is None
    assert length(frames(15), [1] * 15) == 15
    assert length(frames(24, 0.2), [1, 0.1] + [1] * 22) is None


def test_fixed_length_ignores_similarity_and_entropy():
    fixed = SequenceConfig(fixed_length=10)
    assert length(frames(9), [1] * 9, fixed) is None
    assert length(frames(30, 0.1), [1] * 30, fixed) == 10


def test_uninformative_frames_are_passed_over():
    mixed = [frame(), frame(0.0, informative=False), frame(), frame()]
    assert length(mixed, [1, 0.0, 0.5, 1]) == 3


@given(st.lists(st.tuples(st.floats(0, 1), st.floats(0, 0.8)), min_size=1, max_size=40))
def test_chosen_length_is_within_its_bounds_and_within_the_frames(drawn):
    similar, entropies = zip(*drawn, strict=True)
    found = length([frame(value) for value in entropies], similar)
    assert found is None or 2 <= found <= min(25, len(drawn))


def flipped(row, count):
    """Return the scores of a row with a map of so many references that is read from its end."""
    if row is None:
        return None
    whole = np.full(count, np.nan, np.float32)
    whole[: len(row)] = row
    return whole[::-1]


def scored(rows, forward=False, ends=None, **more):
    """
    Return the sequence scores of windows that lie before the anchor or, forward, after it.

    Forward, later references count as earlier ones, as if the map were read from its end.
    """
    if not forward:
        return sequence_scores(rows, ends=ends, **more)
    count = len(rows[0])
    if ends is not None:
        ends = count - 1 - ends[::-1]
    return sequence_scores([flipped(row, count) for row in rows], ends=ends, **more)[::-1]


def test_hand_worked_two_by_two_diagonal():
    newest, older = np.array([0.1, 0.9], np.float32), np.array([0.7, 0.2], np.float32)
    scores = sequence_scores([newest, older])
    assert scores[0] == -np.inf and scores[1] == pytest.approx((0.9 + 0.7) / 2)


def test_hand_worked_forward_window_starts_at_the_anchor():
    oldest, newer = np.array([0.7, 0.2], np.float32), np.array([0.1, 0.9], np.float32)
    scores = scored([oldest, newer], forward=True)
    assert scores[0] == pytest.approx((0.7 + 0.9) / 2) and scores[1] == -np.inf


@given(st.integers(1, 8), st.integers(1, 12), st.integers(0, 99))
def test_scores_are_means_of_diagonals_in_both_directions(k, count, seed):
    rows = list(np.random.default_rng(seed).random((k, count), np.float32))
    for forward, step in ((False, -1), (True, 1)):
        scores = scored(rows, forward)
        for index in range(count):
            if not 0 <= index + step * (k - 1) < count:
                assert scores[index] == -np.inf
            else:
                diagonal = [rows[offset][index + step * offset] for offset in range(k)]
                assert scores[index] == pytest.approx(np.mean(diagonal), abs=1e-6)


def test_an_uninformative_query_frame_does_not_break_the_diagonal():
    rows = [np.array([0, 0, 0.9], np.float32), None, np.array([0.7, 0, 0], np.float32)]
    scores = sequence_scores(rows)
    assert scores[2] == pytest.approx(0.8)


def test_an_uninformative_reference_is_never_matched_nor_breaks_its_neighbours():
    rows = [np.array([0.8, np.nan, 0.8, 0.8], np.float32)] * 3
    scores = sequence_scores(rows)
    assert scores[:2].tolist() == [-np.inf, -np.inf]
    assert scores[2:] == pytest.approx(0.8)


def test_a_diagonal_that_is_mostly_unknown_gives_no_score():
    row = np.full(4, 0.8, np.float32)
    assert (sequence_scores([row, None, None]) == -np.inf).all()


def test_a_window_longer_than_the_map_scores_nothing():
    rows = [np.full(3, 0.8, np.float32)] * 5
    assert (sequence_scores(rows) == -np.inf).all()


@pytest.mark.parametrize('forward', [False, True])
@pytest.mark.parametrize('velocity', [0.5, 1.0, 2.0])
@given(data=st.data())
def test_chosen_ends_have_the_scores_that_they_have_among_all(data, forward, velocity):
    rows = drawn_rows(data)
    count = len(rows[0])
    ends = np.array(sorted(data.draw(st.sets(st.integers(0, count - 1)))), np.int64)
    whole = scored(rows, forward, velocity=velocity)
    assert scored(rows, forward, ends, velocity=velocity) == pytest.approx(whole[ends], abs=1e-6)
    assert whole.shape == (count,)


@pytest.mark.parametrize('forward', [False, True])
@pytest.mark.parametrize('velocity', [0.5, 1.0, 2.0])
@given(data=st.data())
def test_scores_are_those_of_the_definition(data, forward, velocity):
    rows, expected, direction = drawn_rows(data), [], 1 if forward else -1
    for end in range(len(rows[0])):
        met = [end + direction * int(offset * velocity + 0.5) for offset in range(len(rows))]
        pairs = [
            row[index] if row is not None and 0 <= index < len(row) else np.nan
            for row, index in zip(rows, met, strict=True)
        ]
        known = np.isfinite(pairs)
        fits = known[0] and 0 <= met[-1] < len(rows[0]) and 2 * known.sum() >= len(rows)
        expected.append(np.mean(np.array(pairs, float)[known]) if fits else -np.inf)
    assert scored(rows, forward, velocity=velocity) == pytest.approx(expected)


def test_what_an_older_row_lacks_counts_as_unknown():
    newest, older = np.full(4, 0.8, np.float32), np.array([0.2, 0.4], np.float32)
    scores = sequence_scores([newest, older, older])
    assert scores.tolist()[:2] == [-np.inf, -np.inf]
    assert scores[2:] == pytest.approx([(0.8 + 0.4 + 0.2) / 3, (0.8 + 0.4) / 2])


def drawn_rows(data):
    """Draw rows, some of them shorter than the newest, None, or with unknown pairs."""
    rng = np.random.default_rng(data.draw(st.integers(0, 999)))
    count = data.draw(st.integers(1, 14))
    rows = [rng.random(count, np.float32)]
    for _ in range(data.draw(st.integers(0, 6))):
        row = rng.random(int(rng.integers(0, count + 1)) if rng.random() < 0.3 else count)
        rows.append(None if rng.random() < 0.2 else row.astype(np.float32))
    for row in rows:
        if row is not None and rng.random() < 0.4:
            row[rng.random(len(row)) < 0.4] = np.nan
    return rows
