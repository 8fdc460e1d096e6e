# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A tree of all descriptors of a map, and the decision on a frame by itself."""

from importlib.util import find_spec

from convseq_ros.baselines.hamming_tree import HammingTree
from convseq_ros.baselines.local_features import LocalFeatures
from convseq_ros.baselines.loop_detector import Detection
from convseq_ros.config import Config
from convseq_ros.errors import ConfigError
from convseq_ros.evaluation.data_set import DataSet, Part, TruthSource
from convseq_ros.evaluation.material import open_material
from convseq_ros.evaluation.methods import make_method, parse_method
from convseq_ros.evaluation.peers import verified_best
import cv2
import numpy as np
import pytest

needs_pyhbst = pytest.mark.skipif(
    find_spec('pyhbst') is None, reason='needs pyhbst: pip install pyhbst'
)


def keypoints(bits):
    return LocalFeatures(np.zeros((len(bits), 2), np.float32), np.array(bits, np.uint8))


@needs_pyhbst
def test_an_image_scores_the_share_of_query_descriptors_that_it_contains():
    first, second, third = np.random.default_rng(3).integers(0, 256, (3, 4, 32), np.uint8)
    nothing, tree = np.zeros((0, 32)), HammingTree()
    for image in (first, nothing, [*second[:2], *third[:1]]):
        tree.add(keypoints(image))
    assert len(tree) == 3
    assert tree.shares(keypoints(first)).tolist() == [1, 0, 0]
    assert tree.shares(keypoints(second)).tolist() == [0, 0, 0.5]
    assert tree.shares(keypoints(third)).tolist() == [0, 0, 0.25]
    assert tree.shares(keypoints(nothing)).tolist() == [0, 0, 0]
    tree.add(keypoints(third))
    assert tree.shares(keypoints(third)).tolist() == [0, 0, 0.25, 1]


@needs_pyhbst
@pytest.mark.parametrize(('bits', 'share'), [(24, 1), (25, 0)])
def test_descriptors_match_that_are_less_than_25_bits_apart(bits, share):
    tree, one = HammingTree(), np.zeros((1, 32), np.uint8)
    tree.add(keypoints(one))
    one[0] = np.packbits(np.arange(256) < bits)
    assert tree.shares(keypoints(one)).tolist() == [share]


def test_the_reference_with_most_inliers_of_the_5_best_is_taken():
    row = np.arange(8, dtype=np.float32)  # the best 5 are 2 to 6
    row[7] = np.nan
    for best, inliers in ((4, {4: 20, 6: 19}), (6, {4: 20, 6: 20}), (2, {1: 99, 2: 12})):
        found = verified_best(row[None], lambda _, at, inliers=inliers: inliers.get(at, 0))
        assert found == [Detection(best, inliers[best])]
    assert verified_best(row[None], lambda *_: 0) == [Detection(6, 0)]
    assert verified_best(np.zeros((1, 3)), lambda *_: 99) == [Detection()]


def drive(folder, images):
    folder.mkdir()
    for number, image in enumerate(images):
        cv2.imwrite(str(folder / f'{number}.png'), image)
    return Part(folder)


def rows(data_set, text='hbst rows=0'):
    material = open_material(data_set, Config().encoding)
    return make_method(parse_method(text), Config()).rows(material)


@pytest.fixture
def textures():
    small = np.random.default_rng(7).integers(0, 256, (4, 16, 20), np.uint8)
    return [cv2.resize(one, (320, 240), interpolation=cv2.INTER_CUBIC) for one in small]


@needs_pyhbst
def test_hbst_finds_the_place_and_verifies_it(textures, tmp_path):
    moved = [np.roll(one, (3, 5), (0, 1)) for one in textures]
    parts = drive(tmp_path / 'q', moved), drive(tmp_path / 'r', textures)
    data_set = DataSet('s', parts[0], TruthSource('identity', tolerance=0), parts[1])
    pairs = rows(data_set)
    assert pairs.scores.argmax(axis=1).tolist() == [0, 1, 2, 3]
    found = pairs.detect(pairs.scores[:, 1:], 1)
    assert [one.reference for one in found[1:]] == [0, 1, 2]
    assert min(one.inliers for one in found[1:]) > 50 > found[0].inliers
    with pytest.raises(ConfigError, match="rows is not a number: 'low'"):
        rows(data_set, 'hbst rows=low')


@needs_pyhbst
def test_a_drive_against_itself_asks_the_tree_for_its_past_only(textures, tmp_path):
    part = drive(tmp_path / 'q', [*textures, textures[1]])
    scores = rows(DataSet('s', part, TruthSource('none'))).scores
    assert (np.isnan(scores) == np.triu(np.ones((5, 5), bool))).all()
    assert scores[4, 1] == 1 > np.delete(scores[4, :4], 1).max()
