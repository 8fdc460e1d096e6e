# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Golden numbers: the paper restated, and what was published on real recordings."""

import csv
from pathlib import Path
import sys

from convseq_ros import Config, Frame, PlaceRecognizer
from convseq_ros.cli.parameter_file import read_parameter_file
from convseq_ros.config import EncodingConfig, make_config, SequenceConfig, with_values
from convseq_ros.core.decision.paper.length import choose_length
from convseq_ros.core.decision.paper.pair_score import (
    pair_scores,
    paper_regions,
    PaperMatcher,
    PaperSimilarity,
)
from convseq_ros.core.encoding.descriptor import describe, local_entropy
import cv2
import numpy as np
import pytest
from world import map_of

LINEAR = EncodingConfig(resize='linear')  # as in the restatement
REPOSITORY = Path(__file__).resolve().parents[2]
GOLDEN = REPOSITORY / 'test' / 'golden'
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


def test_cells_entropies_and_salient_regions_agree(images, described, golden):
    cells = described[0][0].cells
    assert np.abs(cells - golden['cells']).max() < 1e-4 * golden['cells'].max()
    resized = cv2.resize(images[0][0], (512, 512), interpolation=cv2.INTER_LINEAR)
    small = local_entropy(resized, cv2.INTER_LINEAR)
    bits = cv2.resize(small, (512, 512), interpolation=cv2.INTER_LINEAR)
    assert np.abs(bits[::16, ::16] - golden['bits']).max() < 1e-9
    assert np.abs([one.entropy for one in described[0]] - golden['entropies']).max() < 1e-9
    assert (np.array([one.salient for one in described[0]]) == golden['salient']).all()


@pytest.mark.parametrize(('drive', 'name'), [(1, 'scores'), (0, 'similarities')])
def test_pair_scores_agree(described, golden, drive, name):
    others = [paper_regions(one.cells) for one in described[drive]]
    salient = [paper_regions(one.cells)[one.salient] for one in described[0]]
    scores = np.stack([pair_scores(regions, others) for regions in salient])
    assert np.abs(scores - golden[name]).max() < 1e-5


def test_sequence_lengths_agree(described, golden):
    queries, similarity = described[0], PaperSimilarity()
    for index, expected in enumerate(golden['lengths']):
        assert (choose_length(queries[index::-1], similarity, SequenceConfig()) or 0) == expected


def test_the_recogniser_gives_the_same_lengths_scores_and_best_matches(images, described, golden):
    as_published = {'matching': 'regional', 'search': 'exhaustive', 'rival_distance': 0}
    config = with_values(Config(), as_published | {'num_candidates': COUNT})
    recognizer = PlaceRecognizer(map_of(described[1], LINEAR), config)
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


# The paper's method, as users choose it; recordings of which are given as the released code
# decoded them. It reads ahead from the oldest frame of a sequence, and online the newest is the
# first: so the drive is driven backwards, in a map of the other one backwards.
PAPERS = REPOSITORY / 'config' / 'paper.yaml'


def from_bgr(path):
    return cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2GRAY)


def straight_to_grey(path):
    return cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)


class Published:
    """The answers of config/paper.yaml, changed, to drives that are driven backwards."""

    def __init__(self, query, reference, decode, *changes, every=1):
        configs = [make_config(read_parameter_file(PAPERS) | one) for one in changes]
        encoding = configs[0].encoding
        queries, references = (
            [decode(path) for path in sorted(folder.glob('*.jpg'))[::step]][::-1]
            for folder, step in ((query, every), (reference, 1))
        )
        self.described = [describe(gray, encoding) for gray in queries][::-1]
        shown = (describe(gray, encoding) for gray in references)
        reference_map = map_of(shown, encoding, configs[0].keyframes)
        # What recognisers compare is shared, so that two take as long as one.
        matcher = PaperMatcher(reference_map)
        recognizers = [PlaceRecognizer(reference_map, one, matcher=matcher) for one in configs]
        self.answers, last = [[] for _ in changes], len(references) - 1
        shown = zip(queries, self.described[::-1], strict=True)
        for index, (gray, descriptor) in enumerate(shown):
            for recognizer, answers in zip(recognizers, self.answers, strict=True):
                match = recognizer.process(Frame(index, gray), descriptor)
                if best := match.accepted:
                    answer = last - best.reference_index, best.score, match.sequence_length
                    answers.insert(0, (len(queries) - 1 - index, *answer))


@pytest.fixture(scope='module')
def corridor(shared_data):
    return shared_data / 'corridor'


AT_04 = {'saliency_threshold': 0.4, 'fixed_length': 1}


def test_scores_of_single_frames_are_those_of_cohog(corridor):
    config = make_config(read_parameter_file(PAPERS) | AT_04)
    queries, references = (
        [describe(from_bgr(one), config.encoding) for one in sorted(folder.glob('*.jpg'))[::step]]
        for folder, step in ((corridor / 'query', 4), (corridor / 'ref', 1))
    )
    others = [paper_regions(one.cells) for one in references]
    rows = [pair_scores(paper_regions(one.cells)[one.salient], others) for one in queries]
    golden = golden_rows_of(corridor, 'reference_cohog_corridor_ET04_111x111')
    assert np.abs(np.array(rows) - golden[::4]).max() < 1e-4
    assert np.abs(rows - golden_rows_of(corridor, 'vprbench_cohog_scores')[::4]).max() < 3e-3


def test_answers_to_single_frames_are_those_of_cohog(corridor):
    golden = golden_rows_of(corridor, 'reference_cohog_corridor_ET04_111x111')[::2]
    [found] = Published(corridor / 'query', corridor / 'ref', from_bgr, AT_04, every=2).answers
    assert [best for _, best, _, _ in found] == golden.argmax(axis=1).tolist()
    # A map keeps cells in half precision: in one image that takes away a region's faint gradient.
    assert [score for _, _, score, _ in found] == pytest.approx(golden.max(axis=1), abs=2e-3)


def golden_rows_of(corridor, name):
    return np.load(corridor / 'golden' / f'{name}.npy', allow_pickle=False)


def test_all_answers_are_those_of_the_released_script(corridor):
    lengths = {'fixed_length': 0}, {'fixed_length': 10}
    found = Published(corridor / 'query', corridor / 'ref', straight_to_grey, *lengths)
    named = zip(('dynamic', 'static_k10'), (97, 102), found.answers, strict=True)
    for name, count, answers in named:
        golden = np.loadtxt(corridor / f'golden/authors_{name}_corridor.csv', delimiter=',')
        assert len(answers) == len(golden) == count
        for (query, best, score, k), theirs in zip(answers, golden, strict=True):
            assert (query, best) == (theirs[0], theirs[1])
            # By a map, which keeps cells in half precision.
            assert score == pytest.approx(theirs[2], abs=2e-5)
            if name == 'dynamic':
                assert k == theirs[3]
                entropy = np.mean([one.entropy for one in found.described[query : query + k]])
                assert entropy == pytest.approx(theirs[4], abs=1e-6)


@pytest.mark.once
def test_retrieved_images_are_those_of_the_cohog_authors(shared_data):
    folder = shared_data / 'gardens_point'
    with (folder / 'golden' / 'cohog_day_left_to_day_right.csv').open() as file:
        golden = [int(row['retrieved_day_right']) for row in csv.DictReader(file)]
    drives = folder / 'day_left', folder / 'day_right'
    [found] = Published(*drives, straight_to_grey, {'fixed_length': 1}, every=4).answers
    assert [best for _, best, _, _ in found] == golden[::4]
