# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Score matrices and descriptors that somebody else computed, and whole-image HOG."""

from convseq_ros.baselines.score_matrix import read_descriptors, read_scores
from convseq_ros.baselines.whole_image_hog import whole_image_hog
from convseq_ros.errors import SourceError
from convseq_ros.evaluation.methods import cosine_scores
import numpy as np
import pytest


def saved(tmp_path, array):
    np.save(tmp_path / 'a.npy', array)
    return tmp_path / 'a.npy'


def test_the_cosine_of_a_vector_is_one_with_itself_and_zero_with_nothing():
    rows = np.array([[3, 4], [0, 0], [-6, -8]], np.float32)
    assert cosine_scores(rows[:1], rows).tolist() == [[1, 0, -1]]


@pytest.mark.parametrize(
    ('array', 'problem'),
    [
        (np.zeros((3, 2)), r'3 x 2 scores for 2 queries and 3 references.*; transpose it'),
        (np.zeros((4, 4)), '4 x 4 scores for 2 queries'),
        (np.zeros(6), '6 scores for 2'),
        (np.array([[0, np.nan, 0], [0, 0, 0]]), r'NaN or infinity, first at \[0, 1\]'),
        (np.array([[0, 0, 0], [0, 0, np.inf]]), r'NaN or infinity, first at \[1, 2\]'),
        (np.array([['a'] * 3] * 2), 'not a .npy file of plain numbers'),
    ],
)
def test_a_matrix_that_does_not_fit_is_refused_in_one_line(tmp_path, array, problem):
    with pytest.raises(SourceError, match=problem) as caught:
        read_scores(saved(tmp_path, array), 2, 3)
    assert '\n' not in str(caught.value)


def test_pickles_and_texts_are_refused(tmp_path):
    with (tmp_path / 'p.npy').open('wb') as file:  # what says that a pickle follows
        header = {'descr': '|O', 'fortran_order': False, 'shape': (1,)}
        np.lib.format.write_array_header_1_0(file, header)
    (tmp_path / 't.npy').write_text('hello')
    for name in ('p.npy', 't.npy'):
        with pytest.raises(SourceError, match=r'not a file of plain numbers'):
            read_scores(tmp_path / name, 1, 1)
    with pytest.raises(SourceError, match='No such file'):
        read_scores(tmp_path / 'absent.npy', 1, 1)


def test_descriptors_have_one_row_for_each_image(tmp_path):
    path = saved(tmp_path, np.arange(12.0).reshape(3, 2, 2))
    assert read_descriptors(path, 3).shape == (3, 4)
    with pytest.raises(SourceError, match=r'shape \(3, 2, 2\) for 4 images'):
        read_descriptors(path, 4)


def test_hog_knows_an_image_again_and_tells_it_from_others():
    generator = np.random.default_rng(0)
    image, other = (generator.integers(0, 256, (60, 80), np.uint8) for _ in range(2))
    rows = np.stack([whole_image_hog(one) for one in (image, image // 2, other)])
    assert rows.shape == (3, 31 * 31 * 36)
    scores = cosine_scores(rows[:1], rows)[0]
    assert scores[0] == pytest.approx(1)
    assert scores[1] > 0.98 > scores[2]
