# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The matcher: references, kernels and threads behind one interface."""

import os

from convseq_ros.config import EncodingConfig, MatchingConfig
from convseq_ros.core.compiled import library
from convseq_ros.core.decision.paper.pair_score import PaperMatcher
from convseq_ros.core.encoding.descriptor import blank_descriptor
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.similarity import kernels
from convseq_ros.core.similarity.feature_cache import usable_cores
from convseq_ros.core.similarity.matcher import Matcher
from convseq_ros.core.types import Descriptor
import numpy as np
import pytest
from world import map_of


def drawn(seed):
    rng = np.random.default_rng(seed)
    cells = rng.random((32, 32, 8), np.float32) ** 3
    return Descriptor(cells, rng.random(961) < 0.7, 3 + 2 * rng.random((32, 32)), 0.5)


def drawn_map(count, blank=()):
    return map_of(drawn(index).cells * (index not in blank) for index in range(count))


def ours(reference_map, kept=None, threads=1):
    return Matcher(reference_map, MatchingConfig(threads=threads), 0.45, kept)


def papers(reference_map, _kept=None, _threads=1):
    return PaperMatcher(reference_map)


@pytest.fixture(params=[ours, papers])
def made(request):
    return request.param


def test_a_reference_that_shows_nothing_has_no_score_and_such_a_query_no_features(made):
    matcher = made(drawn_map(5, blank=(1, 3)))
    query = matcher.extract(drawn(4))
    found = matcher.scores_of([(query, np.arange(5))])[0]
    assert np.isnan(found).tolist() == [False, True, False, True, False]
    assert np.nanargmax(found) == 4
    assert np.isnan(matcher.scores_of([(query, np.array([3]))])[0]).all()
    assert matcher.shift(query, 1) is None
    assert matcher.field(query, 1, (0.0, 0.0)).shape == (0, 5)
    assert matcher.extract(blank_descriptor(EncodingConfig())) is None
    # Only coherent matching gives the shift.
    assert matcher.shift(query, 4) == ((0.0, 0.0) if made is ours else None)


def test_a_score_depends_on_no_other_reference_thread_or_cache(made):
    reference_map = drawn_map(70, blank=(50,))
    indices = np.random.default_rng(0).permutation(70)
    plain = made(reference_map)
    query = plain.extract(drawn(9))
    expected = plain.scores_of([(query, indices)])[0]
    for kept, threads in ((None, 2), (3, 1), (3, 4)):
        matcher = made(reference_map, kept, threads)
        found = matcher.scores_of([(matcher.extract(drawn(9)), indices)])[0]
        assert np.array_equal(found, expected, equal_nan=True)
    alone = [plain.scores_of([(query, indices[place : place + 1])])[0][0] for place in range(70)]
    assert np.array_equal(alone, expected, equal_nan=True)


@pytest.fixture
def watched(monkeypatch):
    """Return a map that remembers in `reads` which places were read together."""
    reference_map, reads = drawn_map(40, blank=(7,)), []
    read = reference_map.packed_of
    monkeypatch.setattr(reference_map, 'packed_of', lambda of: reads.append([*of]) or read(of))
    return reference_map, reads


def test_rough_features_are_kept_of_three_times_as_many_references(watched):
    reference_map, reads = watched
    matcher = ours(reference_map, kept=4)
    query = matcher.extract(drawn(9))
    matcher.rough_scores(query, np.arange(40))
    reads.clear()
    matcher.rough_scores(query, np.arange(28, 40))
    assert not reads
    matcher.rough_scores(query, np.array([27]))
    assert reads == [[27]]


@pytest.mark.parametrize('threads', [1, 3])
def test_references_are_read_in_one_go_and_once(made, watched, threads):
    reference_map, reads = watched
    matcher = made(reference_map, None, threads)
    query, other = matcher.extract(drawn(9)), matcher.extract(drawn(3))
    reads.clear()
    found = matcher.scores_of([(query, np.array([3, 7, 3])), (other, np.array([30, 9, 3]))])
    assert reads == [[3, 7, 30, 9]]
    assert [len(one) for one in found] == [3, 3] and found[1].argmax() == 2
    for _ in range(2):
        found = matcher.scores_of([(query, np.array([9, 7, 3]))])[0]
        assert found.argmin() == 1 and np.isnan(found[1]) and found[0] > found[2]
    assert len(reads) == 1
    matcher.scores_of([(query, np.array([30, 31, 32]))])
    assert reads[1:] == [[31, 32]]


def test_a_failure_in_any_lot_is_raised_once(made, watched, monkeypatch):
    reference_map, reads = watched
    matcher = made(reference_map, None, 3)
    query = matcher.extract(drawn(0))
    reads.clear()
    with monkeypatch.context() as patch:
        patch.setattr(reference_map, 'packed_of', lambda indices: [None] * len(indices))
        with pytest.raises((AttributeError, TypeError)):
            matcher.scores_of([(query, np.arange(40))])
    matcher.scores_of([(query, np.arange(40))])
    assert reads == [list(range(40))]


def test_without_a_library_the_definition_runs(monkeypatch):
    assert ours(ReferenceMap()).kernel == (library().variant or 'numpy')
    monkeypatch.setattr(kernels, 'available', lambda: False)
    assert ours(ReferenceMap()).kernel == 'numpy'


@pytest.mark.parametrize(
    ('content', 'quota'),
    [('max 100000\n', None), ('100000 100000\n', 1), ('50000 100000\n', 1),
     ('99900000 100000\n', None), ('nonsense', None)],
)  # fmt: skip
def test_a_container_gets_the_threads_that_its_quota_pays_for(tmp_path, content, quota):
    (tmp_path / 'cpu.max').write_text(content)
    own = len(os.sched_getaffinity(0))
    assert usable_cores(tmp_path / 'cpu.max') == (quota or own)
    assert usable_cores(tmp_path / 'none') == own
