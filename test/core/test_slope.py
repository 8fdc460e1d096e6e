# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Drives at another speed than the map's."""

from convseq_ros.core.sequence import velocity as slope_module
from convseq_ros.core.sequence.diagonals import diagonal, sequence_scores
from convseq_ros.core.sequence.velocity import SLOPES, SlopeSearch
import numpy as np
import pytest

FRAMES, REFERENCES, K = 60, 140, 10


def rows_at(slope, seed=0):
    """Return a row a frame of noise in which the true place stands out."""
    rng = np.random.default_rng(seed)
    scores = rng.normal(0.1, 0.02, (FRAMES, REFERENCES)).astype(np.float32)
    for frame in range(FRAMES):
        true = 5 + round(frame * slope)
        if true < REFERENCES:
            scores[frame, true] += 0.2
    return list(scores)


def follow(rows):
    search = SlopeSearch()
    return [search.follow(rows[index - K + 1 : index + 1][::-1]) for index in range(K, FRAMES)]


@pytest.mark.parametrize('slope', sorted(SLOPES))
def test_the_slope_of_the_drive_is_found(slope):
    found = follow(rows_at(slope))
    assert found[-1] == pytest.approx(slope, abs=0.08)


def test_equal_speed_is_kept_where_other_slopes_stand_out_hardly_more():
    rows = rows_at(1.0)
    for frame, row in enumerate(rows):
        row[min(REFERENCES - 1, 60 + round(frame * 0.8))] += 0.2
    assert set(follow(rows)) == {1.0}


@pytest.mark.parametrize('slope', [1.0, 2.0])
@pytest.mark.parametrize('seed', range(5))
def test_frames_of_unknown_streets_are_soon_outvoted(slope, seed):
    unknown, soon = 40, 4
    rows = list(np.random.default_rng(seed).normal(0.1, 0.02, (70, 200)).astype(np.float32))
    for frame, row in enumerate(rows):
        known = frame - unknown
        place, height = (20 + 1.5 * frame, 0.05) if known < 0 else (60 + slope * known, 0.2)
        row[round(place)] += height
    search = SlopeSearch()
    found = [search.follow(rows[index - K + 1 : index + 1][::-1]) for index in range(K, 70)]
    assert 1.5 in found[: unknown - K]
    assert found[unknown - K + soon :] == pytest.approx([slope] * (30 - soon), abs=0.26)


def test_short_sequences_tell_no_slope():
    search, rows = SlopeSearch(), rows_at(2.0)
    assert {search.follow(rows[index - 4 : index][::-1]) for index in range(10, 50)} == {1.0}


def test_unknown_pairs_and_frames_do_not_change_the_slope():
    rows = rows_at(1.5)
    for row in rows:
        row[[3, 77]] = np.nan
    search = SlopeSearch()
    for index in range(K, FRAMES):
        window = rows[index - K + 1 : index + 1][::-1]
        window[3] = None
        found = search.follow(window)
    assert found == 1.5


def test_whole_rows_and_shorter_ones_are_summed_up_by_the_same_rule(monkeypatch):
    """Rows that lack a reference at their end are summed by the rule, and whole ones are not."""
    rows, asked = rows_at(1.25), []

    def rule(*arguments, **more):
        asked.append(arguments)
        return sequence_scores(*arguments, **more)

    def prominence(window):
        search = SlopeSearch()
        search.follow(window)
        return search._prominence

    window = rows[20 - K + 1 : 21][::-1]
    found = prominence(window)
    expected = []
    for slope in SLOPES:
        scores = sequence_scores(window, slope=slope, dtype=np.float32)
        scores = scores[np.isfinite(scores)]
        expected.append(float(scores.max() - scores.mean()) ** 3)
    assert found.tolist() == expected
    monkeypatch.setattr(slope_module, 'sequence_scores', rule)
    assert prominence(window).tolist() == expected and not asked
    shorter = [window[0], *(row[:-3] for row in window[1:])]
    assert prominence(shorter) == pytest.approx(expected, abs=0.02) and asked


def test_a_new_drive_starts_anew():
    search, rows = SlopeSearch(), rows_at(2.0)
    for index in range(K, 40):
        search.follow(rows[index - K + 1 : index + 1][::-1])
    search.reset()
    rows = rows_at(1.0)
    assert search.follow(rows[:K][::-1]) == 1.0


def test_a_diagonal_of_slope_two_meets_every_second_reference():
    assert diagonal(4, 2.0) == [0, 2, 4, 6]
    assert diagonal(5, 0.5) == [0, 1, 1, 2, 2]


def test_hand_worked_score_at_slope_two():
    newest = np.array([0, 0, 0.9, 0.1], np.float32)
    older = np.array([0.7, 0.3, 0, 0], np.float32)
    scores = sequence_scores([newest, older], slope=2.0)
    assert scores[:2].tolist() == [-np.inf, -np.inf]
    assert scores[2:] == pytest.approx([(0.9 + 0.7) / 2, (0.1 + 0.3) / 2])
