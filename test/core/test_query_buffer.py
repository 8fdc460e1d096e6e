# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The buffer of query frames: what is scored, and what is rescored exactly."""

from dataclasses import replace
from itertools import count
from types import SimpleNamespace

from convseq_ros.config import EncodingConfig
from convseq_ros.core.encoding.descriptor import blank_descriptor
from convseq_ros.core.sequence.query_buffer import QueryBuffer
import numpy as np
import pytest

REFERENCES = 40
NOTHING = blank_descriptor(EncodingConfig())
SHOWN = replace(NOTHING, cells=NOTHING.cells + 1, salient=~NOTHING.salient)


class Approximate:
    """A matcher whose scores are off by up to 0.005, as those of 8-bit kernels are."""

    exact = False

    def __init__(self, scores):
        self.rescored, self._frames = [], count()
        self._exact = scores
        error = np.random.default_rng(1).uniform(-0.005, 0.005, scores.shape)
        self._approximate = (scores + error).astype(np.float32)

    def extract(self, _descriptor):
        """Return what stands for the features of a frame: its number."""
        return SimpleNamespace(frame=next(self._frames), arranged=None)

    def scores_of(self, asked):
        return [self._approximate[query.frame, indices] for query, indices in asked]

    def exact_scores_of(self, asked):
        self.rescored += [(query.frame, index) for query, some in asked for index in some.tolist()]
        return [self._exact[query.frame, indices] for query, indices in asked]


def append(buffer, descriptor=SHOWN):
    buffer.append(descriptor, REFERENCES, most=10)


def filled(scores):
    matcher = Approximate(scores)
    buffer = QueryBuffer(matcher)
    for _ in range(len(scores)):
        append(buffer)
        buffer.score(len(buffer), np.arange(REFERENCES))
    return matcher, buffer


def drawn(seed, frames=1):
    return np.random.default_rng(seed).normal(0.1, 0.01, (frames, REFERENCES)).astype(np.float32)


@pytest.mark.parametrize('seed', range(20))
@pytest.mark.parametrize('frames', [1, 4])
def test_the_best_is_the_exactly_best(seed, frames):
    scores = drawn(seed, frames)
    _, buffer = filled(scores)
    found = buffer.best_scores(frames, np.arange(REFERENCES))
    ends = np.arange(frames - 1, REFERENCES)
    expected = np.mean([scores[frames - 1 - back, ends - back] for back in range(frames)], axis=0)
    assert found[: frames - 1].tolist() == [-np.inf] * (frames - 1)
    assert found.argmax() == ends[expected.argmax()]
    assert found.max() == pytest.approx(expected.max(), abs=1e-7)


def test_no_more_than_eight_are_rescored_and_none_twice():
    matcher, buffer = filled(drawn(3))
    for _ in range(3):
        buffer.best_scores(1, np.arange(REFERENCES))
    assert len(matcher.rescored) == len(set(matcher.rescored))
    assert 8 <= len(matcher.rescored) < 16
