# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Agreement with published results on real sequences, where these are at hand."""

import csv

from convseq_ros.config import EncodingConfig, MatchingConfig, SequenceConfig
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.encoding.regions import paper_regions
from convseq_ros.core.sequence.diagonals import sequence_scores
from convseq_ros.core.sequence.length import choose_length
from convseq_ros.core.similarity.kernels.choice import chosen_kernels
from convseq_ros.core.similarity.kernels.numpy_regional import pair_scores
from convseq_ros.core.similarity.paper_similarity import PaperSimilarity
import cv2
import numpy as np
import pytest

LINEAR = EncodingConfig(resize='linear')  # as what was published
ET_04 = EncodingConfig(resize='linear', saliency_threshold=0.4)


def from_bgr(path):
    return cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2GRAY)


def straight_to_grey(path):
    return cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)


def drive(folder, decode, config=LINEAR):
    return [describe(decode(path), config) for path in sorted(folder.glob('*.jpg'))]


@pytest.fixture(scope='module')
def corridor(shared_data):
    return shared_data / 'corridor'


@pytest.fixture(scope='module')
def cohog_scores(corridor):
    references = [paper_regions(one.cells) for one in drive(corridor / 'ref', from_bgr, ET_04)]
    queries = drive(corridor / 'query', from_bgr, ET_04)
    return np.stack([pair_scores(query, references) for query in queries])


@pytest.mark.parametrize(
    ('name', 'tolerance'),
    [('reference_cohog_corridor_ET04_111x111', 1e-4), ('vprbench_cohog_scores', 3e-3)],
)
def test_single_frame_scores_are_those_of_cohog(corridor, cohog_scores, name, tolerance):
    golden = np.load(corridor / 'golden' / f'{name}.npy', allow_pickle=False)
    assert np.abs(cohog_scores - golden).max() < tolerance


@pytest.fixture(scope='module')
def released(corridor):
    """Return the queries, and each region's best similarity to each reference, unmasked."""
    queries, references = (drive(corridor / name, straight_to_grey) for name in ('query', 'ref'))
    other = [paper_regions(one.cells).T for one in references]
    best = [
        np.stack([(own @ each).max(axis=1) for each in other])
        for own in (paper_regions(one.cells) for one in queries)
    ]
    return queries, best


def forward_results(queries, best, rule):
    """Return (query, reference, score, k, entropy) with the first frame's mask for all frames."""
    similarity = PaperSimilarity()
    for anchor, first in enumerate(queries):
        k = choose_length(queries[anchor:], similarity, rule)
        if k is None:
            continue
        rows = [each[:, first.salient].mean(axis=1) for each in best[anchor : anchor + k]]
        # In a map that is read from its end, later references are earlier ones.
        scores = sequence_scores([row[::-1] for row in rows])[::-1]
        entropy = np.mean([one.entropy for one in queries[anchor : anchor + k]])
        yield anchor, int(scores.argmax()), float(scores.max()), k, entropy


def golden_rows(path):
    with path.open() as file:
        return [[float(value) for value in row] for row in csv.reader(file)]


def test_dynamic_lengths_entropies_and_scores_are_those_of_the_released_script(corridor, released):
    golden = golden_rows(corridor / 'golden' / 'authors_dynamic_corridor.csv')
    found = list(forward_results(*released, SequenceConfig()))
    assert len(found) == len(golden) == 97
    for ours, theirs in zip(found, golden, strict=True):
        assert ours[3] == theirs[3]
        assert ours[4] == pytest.approx(theirs[4], abs=1e-6)
        assert ours[2] == pytest.approx(theirs[2], abs=1e-5)
        assert ours[:2] == (theirs[0], theirs[1])


@pytest.mark.once
def test_retrieved_images_are_those_of_the_cohog_authors(shared_data):
    folder = shared_data / 'gardens_point'
    with (folder / 'golden' / 'cohog_day_left_to_day_right.csv').open() as file:
        golden = [int(row['retrieved_day_right']) for row in csv.DictReader(file)]
    # By the fastest kernel that is exact; the definition itself is asked on corridor.
    _, exact = chosen_kernels(MatchingConfig(matching='regional'))
    references = [exact.prepare(one.cells, None) for one in drive(folder / 'day_right', from_bgr)]
    queries = [exact.extract(one, 4.0, None) for one in drive(folder / 'day_left', from_bgr)]
    found = [int(exact.compare(query, references)[0].argmax()) for query in queries]
    assert sum(a == b for a, b in zip(found, golden, strict=True)) >= 198
