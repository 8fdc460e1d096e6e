# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The buffer of query frames: what is scored, and what is settled exactly."""

from convseq_ros.config import EncodingConfig
from convseq_ros.core.encoding.descriptor import nothing_seen
from convseq_ros.core.sequence.query_buffer import QueryBuffer, Seen
import numpy as np
import pytest

REFERENCES = 40
NOTHING = nothing_seen(EncodingConfig())


class Rough:
    """A matcher whose scores are off by up to 0.005, as those of 8-bit kernels are."""

    exact = False

    def __init__(self, scores):
        self.settled = []
        self._exact = scores
        error = np.random.default_rng(1).uniform(-0.005, 0.005, scores.shape)
        self._rough = (scores + error).astype(np.float32)

    def scores_of(self, asked):
        return [self._rough[query, indices] for query, indices in asked]

    def exact_scores(self, query, indices):
        self.settled += [(query, index) for index in indices.tolist()]
        return self._exact[query, indices]


def filled(scores):
    matcher = Rough(scores)
    buffer = QueryBuffer(matcher, partial=False)
    for query in range(len(scores)):
        buffer.append(Seen(NOTHING, query, np.full(REFERENCES, np.nan, np.float32)), 10)
        buffer.score(len(buffer), np.arange(REFERENCES))
    return matcher, buffer


def drawn(seed, frames=1):
    return np.random.default_rng(seed).normal(0.1, 0.01, (frames, REFERENCES)).astype(np.float32)


@pytest.mark.parametrize('seed', range(20))
@pytest.mark.parametrize('frames', [1, 4])
def test_the_best_is_the_exactly_best(seed, frames):
    scores = drawn(seed, frames)
    _, buffer = filled(scores)
    found = buffer.sequence_scores(frames, np.arange(REFERENCES))
    ends = np.arange(frames - 1, REFERENCES)
    expected = np.mean([scores[frames - 1 - back, ends - back] for back in range(frames)], axis=0)
    assert found[: frames - 1].tolist() == [-np.inf] * (frames - 1)
    assert found.argmax() == ends[expected.argmax()]
    assert found.max() == pytest.approx(expected.max(), abs=1e-7)


def test_only_what_may_be_the_best_is_settled():
    scores = drawn(0)
    scores[0, [7, 20, 30]] = 0.5, 0.49, 0.46
    matcher, buffer = filled(scores)
    found = buffer.sequence_scores(1, np.arange(REFERENCES))
    assert sorted(matcher.settled) == [(0, 7), (0, 20)]
    assert found[[7, 20]].tolist() == scores[0, [7, 20]].tolist()


def test_no_more_than_eight_are_settled_and_none_twice():
    matcher, buffer = filled(drawn(3))
    for _ in range(3):
        buffer.sequence_scores(1, np.arange(REFERENCES))
    assert len(matcher.settled) == len(set(matcher.settled))
    assert 8 <= len(matcher.settled) < 16


def test_no_ends_have_no_scores():
    _, buffer = filled(drawn(0))
    assert buffer.sequence_scores(1, np.zeros(0, np.int64)).shape == (0,)


def test_each_pair_is_scored_once():
    _, buffer = filled(drawn(0, 5))
    assert buffer.pairs_scored == REFERENCES
    buffer.score(5, np.arange(REFERENCES))
    assert buffer.pairs_scored == REFERENCES


@pytest.mark.parametrize('frames', [1, 4, 5])
def test_only_the_better_half_of_the_diagonals_is_scored_to_their_old_ends(frames):
    scores = drawn(3, frames)
    scores[-1, 30] = 0.5
    buffer = QueryBuffer(Rough(scores), partial=True)
    for query in range(frames):
        buffer.append(Seen(NOTHING, query, np.full(REFERENCES, np.nan, np.float32)), 10)
    ends = np.arange(20, 34, 2)
    buffer.score_promising(frames, ends)
    newest = -(-frames // 2)
    scored = [
        sum(np.isfinite(one.row[end - back]) for back, one in enumerate(buffer.outward))
        for end in ends
    ]
    assert scored[5] == frames
    assert sorted(scored) == [newest] * 3 + [frames] * 4
    assert buffer.pairs_scored == sum(scored)


def test_sequences_that_lack_no_scores_are_scored_to_their_old_ends():
    buffer = QueryBuffer(Rough(drawn(3, 5)), partial=False)
    for query in range(5):
        buffer.append(Seen(NOTHING, query, np.full(REFERENCES, np.nan, np.float32)), 10)
    buffer.score_promising(5, np.arange(20, 34, 2))
    assert buffer.pairs_scored == 7 * 5
