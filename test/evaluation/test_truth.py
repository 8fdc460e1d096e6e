# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which references are right."""

from convseq_ros.errors import SourceError
from convseq_ros.evaluation.truth import (
    listed,
    of_the_past,
    read_pairs,
    read_positions,
    same_index,
    Truth,
    within_radius,
)
import numpy as np
import pytest

NAMES = [f'img{index}.jpg' for index in range(6)]


def columns(row):
    return np.flatnonzero(row).tolist()


def test_the_same_index_is_right_within_its_tolerance():
    truth = same_index(6, 6, 1)
    assert columns(truth.right[0]) == [0, 1]
    assert columns(truth.right[3]) == [2, 3, 4]
    assert truth.known.all()


def test_a_slip_is_off_by_three_to_five_frames_at_a_tolerance_of_two():
    truth = same_index(20, 20, 2)
    assert columns(truth.slip[10]) == [5, 6, 7, 13, 14, 15]
    assert not (truth.slip & truth.right).any()


def test_a_query_that_no_pair_names_is_unknown():
    truth = listed(np.array([[1, 2]]), (3, 4), 0, 'table')
    assert truth.known.tolist() == [False, True, False]
    assert columns(truth.right[1]) == [2]


def test_a_pair_may_have_its_own_tolerance():
    truth = listed(np.array([[0, 2, 1], [1, 2, 0]]), (2, 5), 9, 'table')
    assert [columns(row) for row in truth.right] == [[1, 2, 3], [2]]


@pytest.mark.parametrize(
    ('pair', 'text'), [([0, 4], 'reference 4 does not exist'), ([3, 0], 'query 3 does not exist')]
)
def test_a_pair_of_frames_that_do_not_exist_is_refused(pair, text):
    with pytest.raises(SourceError, match=f'gt.csv: {text}'):
        listed(np.array([pair]), (3, 4), 0, 'gt.csv')


def test_positions_within_the_radius_are_right_and_a_missing_one_never_is():
    queries = np.array([[0.0, 0, 0], [np.nan, 0, 0]])
    references = np.array([[0.0, 3, 4], [0, 5.1, 0]])
    right = within_radius(queries, references, 5.0).right
    assert right.tolist() == [[True, False], [False, False]]


def test_against_its_own_past_only_what_is_past_for_long_is_right():
    truth = of_the_past(Truth(np.ones((4, 4), bool)), 2)
    assert [columns(row) for row in truth.right] == [[], [], [0], [0, 1]]


def write(path, text):
    path.write_text(text)
    return path


def test_a_table_names_frames_by_number_or_file_and_several_in_one_cell(tmp_path):
    table = write(tmp_path / 'gt.csv', 'query,reference\n0,1\nimg1,2 3\nimg2.jpg,img4\n')
    assert read_pairs(table, NAMES, NAMES).tolist() == [[0, 1], [1, 2], [1, 3], [2, 4]]


def test_a_table_may_count_from_one_and_hold_tolerances(tmp_path):
    table = write(tmp_path / 'gt.csv', 'frame,revisits,tolerance\n5,1,2\n')
    assert read_pairs(table, NAMES, NAMES, first_index=1).tolist() == [[4, 0, 2]]


@pytest.mark.parametrize(
    ('text', 'problem'),
    [
        ('', 'expected a header'),
        ('query,reference\n1\n', 'line 2'),
        ('query,reference\n1,elsewhere\n', 'line 2 .1,elsewhere. names no frames'),
    ],
)
def test_a_table_that_cannot_be_understood_is_refused_in_one_line(tmp_path, text, problem):
    with pytest.raises(SourceError, match=problem) as caught:
        read_pairs(write(tmp_path / 'gt.csv', text), NAMES, NAMES)
    assert '\n' not in str(caught.value)


def test_positions_come_from_a_table_of_one_or_both_drives(tmp_path):
    both = write(tmp_path / 'both.csv', 'drive,x,y,z\nquery,1,2,3\nreference,4,5,6\n')
    assert read_positions(both, 'reference', 1).tolist() == [[4, 5, 6]]
    plain = write(tmp_path / 'plain.csv', 'x,y\n1,2\n')
    assert read_positions(plain, 'query', 1).tolist() == [[1, 2, 0]]
    with pytest.raises(SourceError, match='1 positions for 2 query images'):
        read_positions(plain, 'query', 2)
    with pytest.raises(SourceError, match='expected a CSV table with the columns x, y, z'):
        read_positions(write(tmp_path / 'bad.csv', 'a,b\n1,2\n'), 'query', 1)
