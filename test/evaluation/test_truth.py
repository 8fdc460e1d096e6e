# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which references are right."""

import resource

from convseq_ros.errors import SourceError
from convseq_ros.evaluation.truth import listed, of_the_past, same_index, Truth, within_radius
from convseq_ros.evaluation.truth_file import read_npy, read_pairs, read_positions
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


def test_the_truth_of_vpr_bench_is_read(tmp_path):
    rows = np.empty((2, 2), object)
    rows[0], rows[1] = [0, [0, 1]], [1, np.array([2])]
    np.save(tmp_path / 'gt.npy', rows, allow_pickle=True)
    assert read_npy(tmp_path / 'gt.npy', (2, 3)).tolist() == [[0, 0], [0, 1], [1, 2]]


def test_plain_arrays_of_pairs_or_flags_are_read(tmp_path):
    np.save(tmp_path / 'pairs.npy', np.array([[0, 2], [1, 0]]))
    np.save(tmp_path / 'flags.npy', np.eye(2, 3, dtype=bool))
    assert read_npy(tmp_path / 'pairs.npy', (2, 3)).tolist() == [[0, 2], [1, 0]]
    assert read_npy(tmp_path / 'flags.npy', (2, 3)).tolist() == [[0, 0], [1, 1]]


class Harmful:
    def __reduce__(self):
        return (print, ('loaded',))


def test_a_pickle_that_would_run_code_is_refused(tmp_path, capsys):
    np.save(tmp_path / 'gt.npy', np.array([[0, Harmful()]], object), allow_pickle=True)
    with pytest.raises(SourceError, match=r'builtins\.print, which is no array'):
        read_npy(tmp_path / 'gt.npy', (1, 1))
    assert capsys.readouterr().out == ''


def npy(path, pickled):
    """Write a file as NumPy does, of two rows of two objects, with a pickle of our own."""
    np.save(path, np.empty((2, 2), object), allow_pickle=True)
    whole = path.read_bytes()
    path.write_bytes(whole[: whole.index(b'\x80')] + pickled)
    return path


def objects(data, kind=b'O8'):
    """Return a pickle, as text, of an array with 4 values; its shape is that of the header."""
    array = b'cnumpy._core.multiarray\n_reconstruct\n(cnumpy\nndarray\nI0\nVb\ntR'
    kind = b'cnumpy\ndtype\n(V%s\nI0\nI1\ntR(I3\nV|\nNNNI-1\nI-1\nI63\ntb' % kind
    return array + b'(I1\n(I2\nI2\nt' + kind + b'I00\n' + data + b'tb.'


ROWS = b'(I0\n(I0\nI1\nlI1\n(I2\nll'
DOUBLED = b'(I0\nlp0\n0' + b'(g0\ng0\nlp0\n0' * 60  # a list of two, of which each is two, ...
HARMFUL_PICKLES = {
    'a type that is none': objects(b"S'%s'\n" % (b'x' * 32), b'V8'),
    'bytes for objects': objects(b"S'%s'\n" % (b'x' * 32)),
    'too few values': objects(b'(I0\nl'),
    'a list of lists without end': objects(DOUBLED + b'(I0\ng0\nI1\ng0\nl'),
    'a name of another': b'cos\nsystem\n(Vtrue\ntR.',
    'what is no array': b'(I0\nl.',
    'a number of gigabytes': b'\x80\x04]r\xff\xff\xff\x0f.',
    'a text of terabytes': b'\x80\x04\x8d' + (2**42).to_bytes(8, 'little') + b'.',
}


def test_a_pickle_of_rows_is_read(tmp_path):
    assert read_npy(npy(tmp_path / 'gt.npy', objects(ROWS)), (2, 3)).tolist() == [
        [0, 0], [0, 1], [1, 2]
    ]  # fmt: skip


@pytest.mark.parametrize('name', HARMFUL_PICKLES)
def test_a_pickle_that_is_no_truth_does_no_harm(tmp_path, name):
    path = npy(tmp_path / 'gt.npy', HARMFUL_PICKLES[name])
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(SourceError, match=r'gt\.npy: '):
        read_npy(path, (2, 3))
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss < before_kb + 100_000


def test_a_list_that_stands_in_many_rows_is_more_than_there_is(tmp_path):
    data = b'(I0\n(' + b'I1\n' * 7 + b'lp0\nI1\ng0\nl'
    with pytest.raises(SourceError, match='more pairs than there are'):
        read_npy(npy(tmp_path / 'gt.npy', objects(data)), (2, 3))


@pytest.mark.parametrize(
    ('stored', 'problem'),
    [
        (np.eye(3, dtype=bool), 'a matrix of 3 x 3 for 2 queries and 3 references'),
        (np.zeros((2, 3)), 'no truth'),
        (np.array([[0, 'a']], object), 'not query and list'),
    ],
)
def test_an_array_that_is_no_truth_is_refused(tmp_path, stored, problem):
    np.save(tmp_path / 'gt.npy', stored, allow_pickle=True)
    with pytest.raises(SourceError, match=problem):
        read_npy(tmp_path / 'gt.npy', (2, 3))


def test_a_text_that_is_no_npy_file_is_refused(tmp_path):
    with pytest.raises(SourceError, match=r'not a readable \.npy file'):
        read_npy(write(tmp_path / 'gt.npy', 'hello'), (1, 1))


def test_positions_come_from_a_table_of_one_or_both_drives(tmp_path):
    both = write(tmp_path / 'both.csv', 'drive,x,y,z\nquery,1,2,3\nreference,4,5,6\n')
    assert read_positions(both, 'reference', 1).tolist() == [[4, 5, 6]]
    plain = write(tmp_path / 'plain.csv', 'x,y\n1,2\n')
    assert read_positions(plain, 'query', 1).tolist() == [[1, 2, 0]]
    with pytest.raises(SourceError, match='1 positions for 2 query images'):
        read_positions(plain, 'query', 2)
    with pytest.raises(SourceError, match='expected a CSV table with the columns x, y, z'):
        read_positions(write(tmp_path / 'bad.csv', 'a,b\n1,2\n'), 'query', 1)
