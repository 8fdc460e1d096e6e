# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""SeqSLAM, HOG, bags of words and VLAD, by hand and beside second implementations."""

from dataclasses import replace
from itertools import pairwise

from convseq_ros.baselines.local_features import (
    COUNT,
    indexed_matches,
    inliers,
    mutual_matches,
    orb,
    root_sift,
)
from convseq_ros.baselines.loop_detector import detect, Detection, islands
from convseq_ros.baselines.seqslam import (
    differences,
    enhanced,
    patch_normalized,
    trajectory_scores,
)
from convseq_ros.baselines.vlad import learnt_centres, means, nearest, vlad
from convseq_ros.baselines.vocabulary import bag_scores, Vocabulary
from convseq_ros.baselines.whole_image_hog import whole_image_hog
from convseq_ros.errors import SourceError
from convseq_ros.evaluation.given_files import read_descriptors, read_scores
from convseq_ros.evaluation.methods import cosine_scores
import cv2
from hypothesis import given, strategies
import numpy as np
import pytest


@pytest.fixture
def random():
    return np.random.default_rng(5)


def signs(descriptors):
    return np.unpackbits(descriptors, axis=1).astype(np.float32) * 2 - 1


def drawn(random, count):
    return [random.integers(0, 256, (60, 32), np.uint8) for _ in range(count)]


def textured(random, size=(240, 320)):
    small = random.integers(0, 256, (size[0] // 8, size[1] // 8), np.uint8)
    return cv2.resize(small, size[::-1], interpolation=cv2.INTER_CUBIC)


def test_words_are_those_that_opencvs_matcher_finds(random):
    images = drawn(random, 6)
    flat = Vocabulary(images, branches=20, levels=1)
    centres = signs(flat._centres[0])
    for image in images:
        # As BOWImgDescriptorExtractor does; of words as near as each other, the first or any.
        matches = cv2.BFMatcher(cv2.NORM_L2).match(signs(image), centres)
        theirs = np.array([one.trainIdx for one in matches])
        products = signs(image) @ centres.T
        is_clear = (products == products.max(axis=1, keepdims=True)).sum(axis=1) == 1
        assert is_clear.any()
        assert (flat.words(image)[is_clear] == theirs[is_clear]).all()


def test_tf_idf_is_scikit_learns(random):
    text = pytest.importorskip('sklearn.feature_extraction.text')
    images = drawn(random, 8)
    own = Vocabulary(images, branches=5, levels=2)
    counts = np.array([np.bincount(own.words(one), minlength=len(own)) for one in images])
    theirs = text.TfidfTransformer(norm=None, smooth_idf=False).fit(counts)
    assert own.idf == pytest.approx(theirs.idf_ - 1, abs=1e-6)
    bags = np.array([own.bag(one) for one in images])
    expected = counts * (theirs.idf_ - 1)
    assert bags == pytest.approx(expected / expected.sum(axis=1, keepdims=True), abs=1e-6)


def test_bags_are_scored_by_the_l1_distance(random):
    bags = random.random((5, 40)).astype(np.float32)
    bags /= bags.sum(axis=1, keepdims=True)
    expected = 1 - np.abs(bags[0] - bags).sum(axis=1) / 2
    assert bag_scores(bags[0], bags) == pytest.approx(expected, abs=1e-6)


def test_a_vocabulary_is_the_same_each_time_and_of_few_words_for_few_descriptors(random):
    images = drawn(random, 3)
    first, second = Vocabulary(images), Vocabulary(images)
    assert (first.words(images[0]) == second.words(images[0])).all()
    same = Vocabulary([np.zeros((30, 32), np.uint8)])
    assert len(same) == 1
    assert not Vocabulary([np.zeros((0, 32), np.uint8)]).bag(np.zeros((0, 32), np.uint8)).any()


def test_a_deep_tree_has_many_words_and_each_descriptor_finds_its_own(random):
    images = [random.integers(0, 256, (1000, 32), np.uint8) for _ in range(4)]
    deep = Vocabulary(images, branches=10, levels=5)
    words = np.concatenate([deep.words(image) for image in images])
    assert len(deep) > 1000  # of 4,000 descriptors, in leaves of at most 10
    assert sorted(set(words.tolist())) == [*range(len(deep))]
    assert (deep.words(images[0].copy()) == words[:1000]).all()
    # Nodes are the words' common ancestors: none above, one at the root, nested in between.
    nodes = [np.concatenate([deep.nodes(image, above) for image in images]) for above in range(6)]
    assert (nodes[0] == -1 - words).all() and not nodes[5].any()
    counts = [len(set(level.tolist())) for level in nodes]
    assert counts == sorted(counts, reverse=True) and counts[4] == 10
    for lower, upper in pairwise(nodes):
        assert len(set(zip(lower.tolist(), upper.tolist(), strict=True))) == len(
            set(lower.tolist())
        )


def test_a_visual_word_in_every_image_has_no_weight_and_a_rare_one_has():
    common, rare = np.zeros((2, 32), np.uint8), np.full((2, 32), 255, np.uint8)
    own = Vocabulary([common, common, common, np.concatenate((common, rare))], levels=6)
    assert len(own) == 2
    assert own.idf[own.words(common)] == pytest.approx(0)
    assert own.idf[own.words(rare)] == pytest.approx(np.log(4))


def test_centres_are_scikit_learns(random):
    cluster = pytest.importorskip('sklearn.cluster')
    rows = random.normal(size=(300, 8)).astype(np.float32)
    started = rows[:6]
    theirs = cluster.KMeans(6, init=started, n_init=1, max_iter=20, tol=0).fit(rows)
    assert means(rows, started, 20) == pytest.approx(theirs.cluster_centers_, abs=1e-4)
    assert (nearest(rows, theirs.cluster_centers_) == theirs.labels_).all()


def test_vlad_is_its_definition_by_hand():
    centres = np.array([[0, 0], [10, 10]], np.float32)
    rows = np.array([[3, 0], [0, 4], [10, 9]], np.float32)
    # Of the first centre (3, 4) / 5, of the second (0, -1); roots; both of length sqrt(1.4), 1.
    expected = np.array([0.6**0.5, 0.8**0.5, 0, -1]) / 2.4**0.5
    assert vlad(rows, centres) == pytest.approx(expected, abs=1e-6)
    assert not vlad(np.zeros((0, 2), np.float32), centres).any()
    assert learnt_centres([rows], 2).shape == (2, 2)


def test_keypoints_that_moved_alike_are_inliers_and_others_are_not(random):
    image = textured(random)
    moved = cv2.warpAffine(image, np.float32([[1, 0, 9], [0, 1, 4]]), image.shape[::-1])
    for extract in (orb, root_sift):
        keypoints = extract(image)
        assert 50 < len(keypoints.points_px) <= COUNT
        assert inliers(keypoints, extract(moved)) > 50
        assert inliers(keypoints, extract(textured(random))) < 20
        assert inliers(keypoints, extract(np.zeros((1, 1), np.uint8))) == 0


def test_small_images_have_many_keypoints(random):
    """ORB leaves out 31 px at each border: of 120 rows half."""
    small = textured(random, (120, 160))
    assert len(orb(small).points_px) > 500 > len(orb(small, rows=0).points_px)
    points = [root_sift(small, rows=rows).points_px.max(axis=0) for rows in (0, 240)]
    assert (points[0] < (160, 120)).all() and (points[1] > (160, 120)).all()


def test_descriptors_match_only_if_each_is_the_others_nearest():
    query = np.array([[0] * 32, [1] * 32, [255] * 32], np.uint8)
    reference = np.array([[255] * 32, [0] * 32], np.uint8)
    assert mutual_matches(query, reference).tolist() == [[0, 1], [2, 0]]


def test_the_direct_index_matches_within_a_node_only():
    query = np.array([[0] * 32, [255] * 32, [15] * 32], np.uint8)
    reference = np.array([[255] * 32, [0] * 32, [15] * 32], np.uint8)
    assert mutual_matches(query, reference).tolist() == [[0, 1], [1, 0], [2, 2]]
    found = indexed_matches(query, reference, np.array([4, -2, 4]), np.array([-2, 7, 4]))
    # The first has no equal in its node, and 2 is nearer to its own; the ratio is within a node.
    assert found.tolist() == [[1, 0], [2, 2]]
    alone = np.array([[1] * 32], np.uint8), np.array([5])
    near = np.array([[0] * 32, [3] * 32], np.uint8)
    assert mutual_matches(alone[0], near).tolist() == []  # both differ by as much
    assert indexed_matches(alone[0], near, alone[1], np.array([5, 6])).tolist() == [[0, 0]]
    assert not len(indexed_matches(query, reference, np.array([1, 1, 1]), np.array([2, 2, 2])))


def test_nodes_decide_which_keypoints_are_inliers(random):
    image = textured(random)
    keypoints = orb(image)
    one = np.zeros(len(keypoints.points_px), np.int32)
    assert inliers(replace(keypoints, nodes=one), replace(keypoints, nodes=one)) > 50
    assert inliers(replace(keypoints, nodes=one), replace(keypoints, nodes=one + 1)) == 0
    assert replace(keypoints, nodes=one).size_bytes == keypoints.size_bytes + 4 * len(one)


def test_a_loop_takes_more_than_three_frames_that_agree_and_twelve_inliers():
    rows = np.full((8, 30), 0.01, np.float32)
    rows[np.arange(8), np.arange(8) + 10] = 0.5
    found = detect(rows, [0.0] + [0.5] * 7, lambda frame, _: 40 + frame)
    # The first frame has none before it, and says nothing; the next three agree, then it is said.
    assert found[0] == Detection()
    assert [one.inliers for one in found] == [0, 0, 0, 0, 44, 45, 46, 47]
    assert [one.reference for one in found[1:]] == [*range(11, 18)]
    assert not any(one.inliers for one in detect(rows, [0.5] * 8, lambda *_: 0))
    sooner = detect(rows, [0.0] + [0.5] * 7, lambda frame, _: 40 + frame, consistent=1)
    assert [one.inliers for one in sooner] == [0, 0, 42, 43, 44, 45, 46, 47]


def test_a_jump_restarts_the_count_and_unmatched_rows_give_no_loop():
    rows = np.full((8, 30), 0.01, np.float32)
    rows[np.arange(8), [10, 11, 12, 25, 26, 27, 28, 29]] = 0.5
    found = detect(rows, [0.5] * 8, lambda *_: 30)
    assert [bool(one.inliers) for one in found] == [False] * 6 + [True] * 2
    nothing = np.full((3, 4), np.nan, np.float32)
    assert detect(nothing, [0.5] * 3, lambda *_: 30) == [Detection()] * 3


@given(strategies.lists(strategies.integers(0, 60), min_size=1, unique=True))
def test_every_reference_is_in_one_island_of_those_less_than_three_apart(references):
    found = islands(dict.fromkeys(references, 1.0))
    assert sum(one.score for one in found) == len(references)
    assert all(later.first - one.last >= 3 for one, later in pairwise(found))
    found = islands({4: 0.2, 6: 0.5, 9: 0.3})
    assert [(one.first, one.last, one.best) for one in found] == [(4, 6, 6), (9, 9, 9)]


def test_the_cosine_of_a_vector_is_one_with_itself_and_zero_with_nothing():
    rows = np.array([[3, 4], [0, 0], [-6, -8]], np.float32)
    for scale in np.float32((1, 1e-25, 1e25)):
        assert cosine_scores(rows[:1] * scale, rows * scale).tolist() == [[1, 0, -1]]


PICKLE = (
    np.lib.format.magic(1, 0)
    + b'\x76\x00'
    + (b"{'descr': '|O', 'fortran_order': False, 'shape': (1,), }".ljust(117) + b'\n')
)  # says that a pickle follows
DAMAGE = [  # of a file of scores of 2 queries and 3 references
    (np.zeros((3, 2)), r'3 x 2 scores for 2 queries and 3 references.*; transpose it'),
    (np.zeros((4, 4)), '4 x 4 scores for 2 queries'),
    (np.zeros(6), '6 scores for 2'),
    (np.array([[0, np.nan, 0], [0, 0, 0]]), r'NaN or infinity, first at \[0, 1\]'),
    (np.array([[0, 0, 0], [0, 0, np.inf]]), r'NaN or infinity, first at \[1, 2\]'),
    (np.array([['a'] * 3] * 2), 'not a .npy file of plain numbers'),
    (PICKLE, 'not a file of plain numbers'),
    (b'hello', 'not a file of plain numbers'),
    (None, 'No such file'),
]


@pytest.mark.parametrize(('content', 'problem'), DAMAGE)
def test_a_matrix_that_does_not_fit_is_refused_in_one_line(tmp_path, content, problem):
    path = tmp_path / 'a.npy'
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content is not None:
        np.save(path, content)
    with pytest.raises(SourceError, match=problem) as caught:
        read_scores(path, 2, 3)
    assert '\n' not in str(caught.value)


def test_descriptors_have_one_row_for_each_image(tmp_path):
    path = tmp_path / 'a.npy'
    np.save(path, np.arange(12.0).reshape(3, 2, 2))
    assert read_descriptors(path, 3).shape == (3, 4)
    with pytest.raises(SourceError, match=r'shape \(3, 2, 2\) for 4 images'):
        read_descriptors(path, 4)


def test_hog_scores_a_darker_copy_above_another_image():
    generator = np.random.default_rng(0)
    image, other = (generator.integers(0, 256, (60, 80), np.uint8) for _ in range(2))
    rows = np.stack([whole_image_hog(one) for one in (image, image // 2, other)])
    assert rows.shape == (3, 31 * 31 * 36)
    scores = cosine_scores(rows[:1], rows)[0]
    assert scores[0] == pytest.approx(1)
    assert scores[1] > 0.98 > scores[2]


SMALL = (32, 64)


def test_every_patch_has_mean_zero_and_deviation_one():
    image = np.random.default_rng(0).integers(0, 256, SMALL, np.uint8)
    patches = patch_normalized(image).reshape(4, 8, 8, 8)
    assert np.abs(patches.mean(axis=(1, 3))).max() < 1e-5
    assert np.abs(patches.std(axis=(1, 3)) - 1).max() < 1e-5


def test_differences_are_signed_numbers_and_do_not_wrap_round():
    dark = np.zeros(SMALL, np.uint8)
    dark[:, ::2] = 10
    one, other = (patch_normalized(each)[None] for each in (dark, np.roll(dark, 1, axis=1)))
    assert differences(one, other)[0, 0] == pytest.approx(2.0)
    assert differences(one, other) == differences(other, one)
    assert differences(one, one)[0, 0] == 0


def test_enhancement_is_the_deviation_from_the_neighbours():
    row = np.array([[5, 5, 1, 5, 5]], np.float32)
    similarity = enhanced(row, window=4)
    assert similarity[0].argmax() == 2
    assert similarity[0, 2] == pytest.approx((row.mean() - 1) / row.std())
    assert not enhanced(np.full((2, 8), 3, np.float32)).any()


@pytest.mark.parametrize('velocity', [0.8, 1.0, 1.2])
def test_a_trajectory_is_found_at_its_velocity(velocity):
    rows = [np.eye(1, 40, 30 - round(age * velocity), dtype=np.float32)[0] for age in range(10)]
    scores = trajectory_scores(rows)
    assert scores.argmax() == 30 and scores[30] == 1


def test_no_trajectory_leaves_the_map_and_a_frame_without_similarities_adds_nothing():
    scores = trajectory_scores([np.zeros(12, np.float32)] * 10)
    assert np.isfinite(scores).tolist() == [False] * 7 + [True] * 5
    assert not np.isfinite(trajectory_scores([np.zeros(3, np.float32)] * 10)).any()
    row = np.eye(1, 12, 11, dtype=np.float32)[0]
    assert trajectory_scores([row, None])[11] == 0.5
