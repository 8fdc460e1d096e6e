# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Agreement with an independent restatement of the paper (golden/restatement.py)."""

from pathlib import Path
import sys

from convseq_ros.config import Config, EncodingConfig, EVERY_FRAME, SequenceConfig, with_values
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.encoding.regions import paper_regions
from convseq_ros.core.map.place import pack_cells, Place
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.sequence.length import choose_length
from convseq_ros.core.similarity.kernels.numpy_regional import pair_scores
from convseq_ros.core.similarity.paper_similarity import PaperSimilarity
from convseq_ros.core.types import Frame
import numpy as np
import pytest

from test.core.entropy_map import entropy_map

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
    assert np.abs(entropy_map(resized)[::16, ::16] - golden['bits']).max() < 1e-9


def test_image_entropies_agree(described, golden):
    assert np.abs([one.entropy for one in described[0]] - golden['entropies']).max() < 1e-9


def test_salient_regions_agree(described, golden):
    assert (np.array([one.salient for one in described[0]]) == golden['salient']).all()


@pytest.mark.parametrize(('drive', 'name'), [(1, 'scores'), (0, 'similarities')])
def test_pair_scores_agree(described, golden, drive, name):
    others = [paper_regions(one.cells) for one in described[drive]]
    scores = np.stack([pair_scores(query, others) for query in described[0]])
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
