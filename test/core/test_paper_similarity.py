# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's similarity of two frames of one drive."""

from convseq_ros.config import Config, EncodingConfig, make_config
from convseq_ros.core.compiled import available
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.similarity.pair_score import PairScore
from convseq_ros.core.similarity.paper_similarity import PaperSimilarity
from convseq_ros.core.types import Frame
import numpy as np
import pytest

SMALL = EncodingConfig(image_size_px=128)
DRAWN = np.random.default_rng(0).integers(0, 256, (3, 128, 128), np.uint8)


class CompiledError(Exception):
    """Raised where compiled code would have computed a score."""


@pytest.fixture
def refused(monkeypatch):
    """Let the compiled kernels of the paper's pair score fail."""
    if not available():
        pytest.skip('nothing is compiled on this machine')
    from convseq_ros.core.similarity.kernels import regional

    def refuse(*_args):
        raise CompiledError

    for name in ('float32', 'int8'):
        fields = _fields(getattr(regional, name)(), refuse)
        monkeypatch.setattr(regional, name, lambda fields=fields: PairScore(**fields))


def _fields(pair, compare):
    return {name: getattr(pair, name) for name in pair.__slots__} | {'compare': compare}


def test_the_kernel_that_is_asked_for_rules_the_similarity(refused):
    first, second = (describe(gray, SMALL) for gray in DRAWN[:2])
    with pytest.raises(CompiledError):
        PaperSimilarity('auto')(first, second)
    assert 0 < PaperSimilarity('numpy')(first, second) < 1


def test_a_recogniser_hands_its_kernel_on(refused):
    def answers(config):
        recognizer = PlaceRecognizer(ReferenceMap(config.encoding), config)
        return [recognizer.process(Frame(index * 10**9, gray)) for index, gray in enumerate(DRAWN)]

    settings = {'mode': 'online', 'exclusion_s': 0.0, 'image_size_px': 128}
    with pytest.raises(CompiledError):
        answers(make_config(settings))
    assert len(answers(make_config(settings | {'kernel': 'numpy'}))) == len(DRAWN)


def test_every_kernel_says_the_same():
    first, second = (describe(gray, SMALL) for gray in DRAWN[:2])
    found = [PaperSimilarity(kernel)(first, second) for kernel in ('auto', 'numpy')]
    assert found[0] == pytest.approx(found[1], abs=1e-6)
    assert PaperSimilarity()(first, first) == pytest.approx(1, abs=1e-6)
    assert Config().matching.kernel == 'auto'


def test_a_rough_score_lies_on_the_side_of_the_limit_where_the_exact_one_does():
    described = [describe(gray, SMALL) for gray in DRAWN]
    similarity = PaperSimilarity()
    pairs = [(one, other) for one in described for other in described]
    exact = [similarity(*pair) for pair in pairs]
    for limit in (*exact, *(score + 1e-5 for score in exact), 0.5, 0.9):
        rough = [similarity(*pair, limit) for pair in pairs]
        assert [one > limit for one in rough] == [one > limit for one in exact]
        assert [one >= limit for one in rough] == [one >= limit for one in exact]
