# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Golden numbers: the paper restated, and what was published on real recordings."""

import csv
from pathlib import Path
import sys

from convseq_ros.config import (
    Config,
    EncodingConfig,
    EVERY_FRAME,
    MatchingConfig,
    SequenceConfig,
    with_values,
)
from convseq_ros.core.decision.paper.diagonals import sequence_scores
from convseq_ros.core.decision.paper.length import choose_length
from convseq_ros.core.encoding.descriptor import describe, local_entropy
from convseq_ros.core.encoding.regions import paper_regions
from convseq_ros.core.map.place import pack_cells, Place
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.similarity.kernels import chosen_kernels
from convseq_ros.core.similarity.kernels.numpy_kernels import pair_scores
from convseq_ros.core.similarity.overlap import PaperSimilarity
from convseq_ros.core.types import Frame
import cv2
import numpy as np
import pytest

LINEAR = EncodingConfig(resize='linear')  # as in the restatement
GOLDEN = Path(__file__).resolve().parents[1] / 'golden'
COUNT = 8


@pytest.fixture(scope='module')
def golden():
    with np.load(GOLDEN / 'drawn_street.npz', allow_pickle=False) as stored:
        return dict(stored)


@pytest.fixture(scope='module')
def images():
    sys.path.insert(0, str(GOLDEN))
    try:
        from restatement import drawn_images
    finally:
        sys.path.remove(str(GOLDEN))
    return drawn_images(COUNT, 2, shift_px=6), drawn_images(COUNT, 2)


@pytest.fixture(scope='module')
def described(images):
    return [[describe(image, LINEAR) for image in drive] for drive in images]


def test_cells_agree(described, golden):
    cells = described[0][0].cells
    assert np.abs(cells - golden['cells']).max() < 1e-4 * golden['cells'].max()


def test_entropy_map_agrees(images, golden):
    import cv2

    resized = cv2.resize(images[0][0], (512, 512), interpolation=cv2.INTER_LINEAR)
    small = local_entropy(resized, cv2.INTER_LINEAR)
    bits = cv2.resize(small, (512, 512), interpolation=cv2.INTER_LINEAR)
    assert np.abs(bits[::16, ::16] - golden['bits']).max() < 1e-9


def test_image_entropies_agree(described, golden):
    assert np.abs([one.entropy for one in described[0]] - golden['entropies']).max() < 1e-9


def test_salient_regions_agree(described, golden):
    assert (np.array([one.salient for one in described[0]]) == golden['salient']).all()


def salient(query):
    return paper_regions(query.cells)[query.salient]


@pytest.mark.parametrize(('drive', 'name'), [(1, 'scores'), (0, 'similarities')])
def test_pair_scores_agree(described, golden, drive, name):
    others = [paper_regions(one.cells) for one in described[drive]]
    scores = np.stack([pair_scores(salient(query), others) for query in described[0]])
    assert np.abs(scores - golden[name]).max() < 1e-5


def test_sequence_lengths_agree(described, golden):
    queries, similarity = described[0], PaperSimilarity()
    lengths = [
        choose_length(queries[index::-1], similarity, SequenceConfig()) or 0
        for index in range(COUNT)
    ]
    assert lengths == golden['lengths'].tolist()


def test_the_recogniser_gives_the_same_lengths_scores_and_best_matches(images, described, golden):
    reference_map = ReferenceMap(LINEAR, keyframes=EVERY_FRAME)
    for index, one in enumerate(described[1]):
        reference_map.add(Place(index), pack_cells(one.cells))
    as_published = {'matching': 'regional', 'search': 'exhaustive', 'rival_distance': 0}
    config = with_values(Config(), as_published | {'num_candidates': COUNT})
    recognizer = PlaceRecognizer(reference_map, config)
    for index, image in enumerate(images[0]):
        match = recognizer.process(Frame(index, image))
        assert match.sequence_length == golden['lengths'][index]
        expected = golden['sequence_scores'][index]
        for candidate in match.candidates:
            # Of 8-bit kernels, rivals that cannot win are left as they are.
            allowed = 1e-4 if candidate is match.best else 1e-3
            score = expected[candidate.reference_index]
            assert candidate.score == pytest.approx(score, abs=allowed)
        if match.best:
            assert match.best.reference_index == expected.argmax()


# Every so many of the queries, and those from a number on: their lengths differ.
FEW, FIRST = 4, 60
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
    queries = drive(corridor / 'query', from_bgr, ET_04)[::FEW]
    return np.stack([pair_scores(salient(query), references) for query in queries])


@pytest.mark.parametrize(
    ('name', 'tolerance'),
    [('reference_cohog_corridor_ET04_111x111', 1e-4), ('vprbench_cohog_scores', 3e-3)],
)
def test_single_frame_scores_are_those_of_cohog(corridor, cohog_scores, name, tolerance):
    golden = np.load(corridor / 'golden' / f'{name}.npy', allow_pickle=False)[::FEW]
    assert np.abs(cohog_scores - golden).max() < tolerance


@pytest.fixture(scope='module')
def released(corridor):
    """Return the queries, and each region's best similarity to each reference, unmasked."""
    queries, references = (drive(corridor / name, straight_to_grey) for name in ('query', 'ref'))
    queries, other = queries[FIRST:], [paper_regions(one.cells).T for one in references]
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
    golden = golden_rows(corridor / 'golden' / 'authors_dynamic_corridor.csv')[FIRST:]
    found = list(forward_results(*released, SequenceConfig()))
    assert len(found) == len(golden) == 37
    for ours, theirs in zip(found, golden, strict=True):
        assert ours[3] == theirs[3]
        assert ours[4] == pytest.approx(theirs[4], abs=1e-6)
        assert ours[2] == pytest.approx(theirs[2], abs=1e-5)
        assert (FIRST + ours[0], ours[1]) == (theirs[0], theirs[1])


@pytest.mark.once
def test_retrieved_images_are_those_of_the_cohog_authors(shared_data):
    folder = shared_data / 'gardens_point'
    with (folder / 'golden' / 'cohog_day_left_to_day_right.csv').open() as file:
        golden = [int(row['retrieved_day_right']) for row in csv.DictReader(file)][::FEW]
    # By the fastest kernel that is exact; the definition itself is asked on corridor.
    _, exact = chosen_kernels(MatchingConfig(matching='regional'))
    references = [exact.prepare(one.cells, None) for one in drive(folder / 'day_right', from_bgr)]
    asked = drive(folder / 'day_left', from_bgr)[::FEW]
    queries = [exact.extract(one, 4.0, None) for one in asked]
    found = [int(exact.compare(query, references)[0].argmax()) for query in queries]
    assert sum(a == b for a, b in zip(found, golden, strict=True)) >= 49
