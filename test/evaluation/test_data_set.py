# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Data sets as YAML, and which of their references are right; what is refused in one line."""

import tracemalloc

from convseq_ros.config import EncodingConfig
from convseq_ros.errors import ConfigError, ConvseqError, SourceError
from convseq_ros.evaluation.data_set import open_data_set, ready_made
from convseq_ros.evaluation.material import open_material
from convseq_ros.evaluation.truth import (
    from_pairs,
    past_only,
    positions_in,
    read_pairs,
    read_positions,
    same_index,
    Truth,
    within_radius,
)
import numpy as np
from pictures import written
import pytest

SMALL, BLANK = EncodingConfig(image_size_px=64), np.full((8, 8), 9, np.uint8)


def test_the_papers_data_sets_are_ready_made_and_name_their_folder(tmp_path):
    names = 'alderley campus_loop corridor gardens_point_day_day gardens_point_day_night nordland'
    assert {*names.split()} <= set(ready_made())
    for name in ready_made():
        data_set = open_data_set(name, tmp_path)
        if data_set.query.simulated:
            continue
        assert data_set.query.path.is_relative_to(tmp_path)
        assert 'DATA/' in data_set.where
        assert data_set.source


def test_alderley_pairs_frames_by_their_numbers_from_one(tmp_path):
    for folder in ('FRAMESA', 'FRAMESB'):
        written(tmp_path / 'alderley' / folder, [BLANK] * 8)
    write(tmp_path / 'alderley' / 'framematches.csv', '1,4\n8,5\n')
    right = open_material(open_data_set('alderley', tmp_path), SMALL).truth.right
    assert [columns(row) for row in right[[0, 1, 7]]] == [[1, 2, 3, 4, 5], [], [2, 3, 4, 5, 6]]


@pytest.mark.parametrize(
    'name', ['campus_loop', 'gardens_point_day_day', 'gardens_point_day_night']
)
def test_sets_of_two_equal_drives_pair_equal_frames_within_two(tmp_path, name):
    data_set = open_data_set(name, tmp_path)
    count = data_set.query.count
    for part in (data_set.query, data_set.reference):
        written(part.path, [BLANK] * part.count)
    right = open_material(data_set, SMALL).truth.right
    assert right.shape == (count, count) and columns(right[50]) == [48, 49, 50, 51, 52]


def test_missing_images_of_a_ready_made_set_are_reported_with_the_remedy(tmp_path):
    with pytest.raises(SourceError, match=r'corridor/query is missing; put VPR-Bench') as caught:
        open_material(open_data_set('corridor', tmp_path), EncodingConfig())
    assert '\n' not in str(caught.value)


POSES = '{kind: poses, path: poses.csv, radius_m: 1}'
SOUND = {
    'query': '{path: query}',
    'reference': '{path: reference}',
    'truth': '{kind: identity, tolerance: 1}',
}


def yaml(**changes):
    return '\n'.join(f'{name}: {value}' for name, value in (SOUND | changes).items() if value)


@pytest.mark.parametrize(
    ('text', 'problem'),
    [
        (yaml(truth=''), 'says no truth'),
        (yaml(query=''), 'says no query'),
        (yaml(query='{topic: /a}'), 'query: needs the path of its images, or simu'),
        (yaml(query='{path: query, simulated: {}}'), 'query: needs the path of its images, or si'),
        (yaml(query='query'), 'query is not a list'),
        (yaml(query='{path: query, topic: /a /b}'), "'/a /b' names several cameras"),
        (yaml(truht='{}'), "unknown key 'truht'; did you mean truth"),
        (yaml(truth='{kind: exact}'), "truth: kind 'exact' is not one of identity"),
        (yaml(truth='{kind: table}'), 'truth: table has no path'),
        (yaml(truth='{kind: poses}'), 'truth: poses has no radius_m'),
        (
            yaml(truth='{kind: identity, tolerance: -1}'),
            'truth: tolerance, radius_m and first_index must not be negative',
        ),
        (yaml(truth='{kind: identity, tolerance: two}'), "tolerance: 'two' is not a number"),
        (yaml(reference=''), 'truth identity needs a reference'),
        (yaml(exclude_recent='-1'), 'exclude_recent is -1; give at least 0'),
        (yaml(truth='{kind: poses, radius_m: 1, tolerance: 2}'), 'poses has no tolerance; leave'),
        (yaml(truth='{kind: identity, path: a.csv}'), 'truth: identity has no path; leave it out'),
        (yaml(name='a/b'), "name 'a/b' is no folder name"),
        (yaml(published='{../net: net.npy}'), "name '../net' is no folder name"),
        ('- a', 'the file is not a list'),
        ('a: [', 'not YAML'),
    ],
)
def test_an_invalid_data_set_file_is_refused_in_one_line(street, text, problem):
    with pytest.raises(ConfigError, match=problem) as caught:
        open_data_set(str(street.write(text)))
    assert '\n' not in str(caught.value)


def test_an_unknown_name_lists_the_known_ones(tmp_path):
    with pytest.raises(ConfigError, match='elsewhere: no data set; give a YAML file or one of al'):
        open_data_set('elsewhere')
    with pytest.raises(ConfigError, match=r'absent.yaml: no such file'):
        open_data_set(str(tmp_path / 'absent.yaml'))


@pytest.mark.parametrize(
    ('text', 'problem'),
    [
        (yaml(query='{path: query, count: 30}'), r'24 images in .*query, expected 30'),
        (yaml(query='{path: nowhere}'), 'nowhere is missing'),
        (yaml(truth='{kind: table, path: gt.csv}'), 'reference 99 does not exist, there are 24'),
        (yaml(truth='{kind: table, path: empty.csv}'), 'no query has a right reference'),
        (yaml(truth=POSES), '1 positions for 24 query'),
        (yaml(truth=POSES.replace('poses.csv', 'lost.csv')), 'no query has a right reference'),
        (yaml(query='{path: query, backwards: true}', truth=POSES), 'poses cannot go backwards'),
    ],
)
def test_a_set_whose_parts_disagree_is_refused_in_one_line(street, text, problem):
    street.write('query,reference\n0,99\n', 'gt.csv')
    street.write('query,reference\n', 'empty.csv')
    street.write('drive,x,y\nquery,0,0\n', 'poses.csv')
    street.write('x,y\n' + 'nan,nan\n' * 24, 'lost.csv')
    street.write(text)
    with pytest.raises(ConvseqError, match=problem) as caught:
        street.open()
    assert '\n' not in str(caught.value)


def test_drives_of_different_length_need_another_truth_than_identity(street):
    (street.folder / 'query' / '000.png').unlink()
    street.write(yaml())
    with pytest.raises(SourceError, match='street: truth: identity needs drives of one length'):
        street.open()


def test_positions_give_the_truth(street):
    rows = [f'{drive},{index * 2},0' for drive in ('query', 'reference') for index in range(24)]
    street.write('\n'.join(['drive,x,y', *rows]), 'poses.csv')
    street.write(yaml(truth='{kind: poses, path: poses.csv, radius_m: 2.5}'))
    right = street.open().truth.right
    assert right[5].nonzero()[0].tolist() == [4, 5, 6]


def test_queries_that_no_answer_misses_are_counted(street, loop):
    street.write('query,reference,tolerance\n0,0,99\n1,0,22\n2,12,99\n', 'gt.csv')
    street.write(yaml(truth='{kind: table, path: gt.csv}'))
    assert street.open().unmissable == 2
    # Frame 20 is compared with the first alone, 21 with the first two.
    loop.write('query,reference\n20,0\n21,0\n', 'loops.csv')
    text = 'query: {path: drive}\ntruth: {kind: table, path: loops.csv}'
    loop.write(text)
    assert loop.open().unmissable == 1
    loop.write(f'{text}\nexclude_recent: 0')
    assert loop.open().unmissable == 0


NAMES = [f'img{index}.jpg' for index in range(6)]


def columns(row):
    return np.flatnonzero(row).tolist()


def test_the_same_index_is_right_within_its_tolerance_and_a_slip_three_frames_further():
    truth = same_index(20, 20, 2)
    assert columns(truth.right[0]) == [0, 1, 2]
    assert columns(truth.right[10]) == [8, 9, 10, 11, 12]
    assert columns(truth.slip[10]) == [5, 6, 7, 13, 14, 15]
    assert truth.known.all() and not (truth.slip & truth.right).any()


def test_a_query_that_no_pair_names_is_unknown_and_a_pair_may_have_its_own_tolerance():
    truth = from_pairs(np.array([[1, 2]]), (3, 4), 0, 'table')
    assert truth.known.tolist() == [False, True, False]
    assert columns(truth.right[1]) == [2]
    truth = from_pairs(np.array([[0, 2, 1], [1, 2, 0]]), (2, 5), 9, 'table')
    assert [columns(row) for row in truth.right] == [[1, 2, 3], [2]]


@pytest.mark.parametrize(
    ('pair', 'text'), [([0, 4], 'reference 4 does not exist'), ([3, 0], 'query 3 does not exist')]
)
def test_a_pair_of_frames_that_do_not_exist_is_refused(pair, text):
    with pytest.raises(SourceError, match=f'gt.csv: {text}'):
        from_pairs(np.array([pair]), (3, 4), 0, 'gt.csv')


def test_positions_within_the_radius_are_right_and_a_missing_one_never_is():
    queries = np.array([[0.0, 0, 0], [np.nan, 0, 0]])
    references = np.array([[0.0, 3, 4], [0, 5.1, 0]])
    right = within_radius(queries, references, 5.0).right
    assert right.tolist() == [[True, False], [False, False]]


def test_positions_of_long_drives_need_no_more_memory_than_their_truth():
    positions = np.zeros((2000, 3))
    tracemalloc.start()
    truth = within_radius(positions, positions, 1.0)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert truth.right.all() and most < 3 * truth.right.nbytes


def test_against_its_own_past_recent_frames_are_no_right_answers():
    truth = past_only(Truth(np.ones((4, 4), bool)), 2)
    assert [columns(row) for row in truth.right] == [[], [], [0], [0, 1]]


def write(path, text):
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('query,reference\n0,1\nimg1,2 3\nimg2.jpg,img4\n', [[0, 1], [1, 2], [1, 3], [2, 4]]),
        ('Query, Reference\n1,2\n0,3\n', [[1, 2], [0, 3]]),
        ('reference,query\n2,1\n3,0\n', [[1, 2], [0, 3]]),
        ('id,query,reference\n8,1,2\n9,0,3\n', [[1, 2], [0, 3]]),
        ('frame,revisits,why\n1,2,seen\n0,3,heard\n', [[1, 2], [0, 3]]),
        ('tolerance,frame,revisits\n7,1,2\n', [[1, 2, 7]]),
        ('1,2\n0,3\n', [[1, 2], [0, 3]]),
        ('img1,img2.jpg\n0.0,3\n', [[1, 2], [0, 3]]),
        ('IMG1.JPG,img2.jpg\n0,3\n', [[1, 2], [0, 3]]),
    ],
)
def test_columns_of_a_table_are_those_of_its_names_and_without_names_the_first_two(
    tmp_path, text, expected
):
    names = [*NAMES[:1], 'IMG1.JPG' if 'IMG' in text else NAMES[1], *NAMES[2:]]
    table = write(tmp_path / 'gt.csv', text)
    assert read_pairs(table, names, NAMES).tolist() == expected


def test_a_table_may_count_from_one(tmp_path):
    table = write(tmp_path / 'gt.csv', 'frame,revisits,tolerance\n5,1,2\n')
    assert read_pairs(table, NAMES, NAMES, first_index=1).tolist() == [[4, 0, 2]]
    with pytest.raises(SourceError, match=r'query 5 does not exist, there are 4 \(1 to 4\)'):
        from_pairs(np.array([[4, 0]]), (4, 4), 0, 'gt.csv', first_index=1)


def test_a_padded_number_is_the_image_of_that_name_if_there_is_one(tmp_path):
    table = write(tmp_path / 'gt.csv', 'query,reference\n0001,02\n1,0\n0.0,0\n')
    names = ['0001.png', '0002.png']
    assert read_pairs(table, names, names + names).tolist() == [[0, 2], [1, 0], [0, 0]]


@pytest.mark.parametrize(
    ('text', 'problem'),
    [
        ('', 'expected a header'),
        ('query;reference\n0;0\n', 'query, reference, with commas between'),
        ('frame,reference\n0,0\n', 'the columns query, reference'),
        ('query,reference\n1\n', 'line 2'),
        ('query,reference\n\n1,2\n1\n', 'line 4'),
        ('query,reference\n1,elsewhere\n', 'line 2 .1,elsewhere. names no frames'),
        ('query,reference\n1,0.7\n', 'names no frames'),
        ('query,reference\n1,1_0\n', 'names no frames'),
        ('query,reference\n1,-1\n', 'names no frames'),
        ('query,reference,tolerance\n1,0,-3\n', 'names no frames'),
        ('query,reference\n1,0,2\n', 'line 2 .1,0,2. has more cells than the first line'),
    ],
)
def test_an_invalid_table_of_pairs_is_refused_in_one_line(tmp_path, text, problem):
    with pytest.raises(SourceError, match=problem) as caught:
        read_pairs(write(tmp_path / 'gt.csv', text), NAMES, NAMES)
    assert '\n' not in str(caught.value)


def test_positions_come_from_a_table_of_one_or_both_drives(tmp_path):
    both = write(tmp_path / 'both.csv', 'drive,x,y,z\nquery,1,2,3\nreference,4,5,6\n')
    assert read_positions(both, 'reference', NAMES[:1]).tolist() == [[4, 5, 6]]
    named = write(tmp_path / 'named.csv', 'Drive, X, Y\nQuery,1,2\nQuery,inf,2\n')
    found = read_positions(named, 'query', NAMES[:2])
    np.testing.assert_array_equal(found, [[1, 2, 0], [np.nan] * 3])
    plain = write(tmp_path / 'plain.csv', 'x,y\n1,2\n')
    assert read_positions(plain, 'query', NAMES[:1]).tolist() == [[1, 2, 0]]
    with pytest.raises(SourceError, match='1 positions for 2 query images'):
        read_positions(plain, 'query', NAMES[:2])
    with pytest.raises(SourceError, match='expected a CSV table with the columns x, y, z'):
        read_positions(write(tmp_path / 'bad.csv', 'a,b\n1,2\n'), 'query', NAMES[:1])


@pytest.mark.parametrize('row', ['1,5,2,5', '1,', '1', '"1,5",2', 'N/A,2'])
def test_a_row_that_tells_no_position_is_named_with_its_line(tmp_path, row):
    table = write(tmp_path / 'p.csv', f'x,y\n0,0\n\n{row}\n')
    with pytest.raises(SourceError, match=rf'p.csv: line 4 \({row}\) tells no position; expected'):
        read_positions(table, 'query', NAMES[:2])


@pytest.mark.parametrize(
    'text',
    [
        'image,x,y\nimg1.jpg,1,9\nimg7.jpg,7,9\nimg0.jpg,0,9\n',
        'x,y,Name\n1,9,img1\n0,9,img0\n',
        'name,filename,x,y\nlater,left/img1.jpg,1,9\nfirst,left/img0.jpg,0,9\n',
    ],
)
def test_a_table_that_names_images_gives_positions_by_name_and_not_by_order(tmp_path, text):
    table = write(tmp_path / 'poses.csv', text)
    assert read_positions(table, 'query', NAMES[:2]).tolist() == [[0, 9, 0], [1, 9, 0]]


@pytest.mark.parametrize(
    ('latitude', 'metres'), [(0, (110574.3, 111319.5)), (60, (111412.3, 55799.5))]
)
def test_degrees_become_metres_on_the_ellipsoid(tmp_path, latitude, metres):
    # The lengths of a degree of latitude and of longitude are those of the published table.
    north, east = latitude + 1e-3, 153.001
    rows = f'{latitude},153\n{north},153\n{latitude},{east}\n'
    for names in ('lat,lon', 'Latitude, Longitude'):
        table = write(tmp_path / 'p.csv', f'{names}\n{rows}')
        start, *ends = read_positions(table, 'query', NAMES[:3])
        distances = [1000 * np.linalg.norm(end - start) for end in ends]
        assert distances == pytest.approx(metres, abs=3)


def test_of_degrees_and_metres_metres_count_and_degrees_have_bounds(tmp_path):
    both = write(tmp_path / 'both.csv', 'lat,lon,x,y,z\n9,9,1,2,3\n')
    assert read_positions(both, 'query', NAMES[:1]).tolist() == [[1, 2, 3]]
    high = write(tmp_path / 'high.csv', 'lat,lon,z\n0,0,100\n90,0,100\n')
    found = read_positions(high, 'query', NAMES[:2])
    assert found == pytest.approx(np.array([[6378237, 0, 0], [0, 0, 6356852.3]]), abs=0.1)
    swapped = write(tmp_path / 'swapped.csv', 'lat,lon\n153,-27\n')
    with pytest.raises(SourceError, match='x, y, z in metres, or lat, lon in degrees'):
        read_positions(swapped, 'query', NAMES[:1])


def test_degrees_that_are_called_metres_are_refused(street):
    rows = [f'-27.{index:04},153.02' for index in range(24)]
    street.write('\n'.join(['x,y', *rows, 'nan,nan']), 'poses.csv')
    text = yaml(truth='{kind: poses, path: poses.csv, radius_m: 5}')
    (street.folder / 'query' / '024.png').write_bytes(b'')
    (street.folder / 'reference' / '024.png').write_bytes(b'')
    street.write(text)
    with pytest.raises(SourceError, match=r'every place would be right; .* columns lat, lon'):
        street.open()
    street.write('\n'.join(['lat,lon', *rows, 'nan,nan']), 'poses.csv')
    street.write(text.replace('5}', '12}'))  # 11 m a row
    right = street.open().truth.right
    assert columns(right[5]) == [4, 5, 6] and columns(right[24]) == []


def test_names_of_images_may_tell_where_they_are(street):
    for drive, offset in (('query', 3), ('reference', 0)):
        for index in range(24):
            image = street.folder / drive / f'{index:03d}.png'
            name = f'@{545000 + 2 * (index + offset):010.2f}@4180123.45@10@S@{index}@.png'
            image.rename(image.with_name(name))
    street.write(yaml(truth='{kind: poses, radius_m: 2.5}'))
    assert columns(street.open().truth.right[5]) == [7, 8, 9]
    for names in (['@1@2@.jpg', 'img1.jpg'], ['@1@two@.jpg'], ['@1@2.jpg']):
        assert positions_in(names) is None


@pytest.mark.parametrize(
    ('rows', 'problem'),
    [
        ('img0.jpg,0,0\nother.jpg,0,0\n', 'no row names 1 of 2 query images, such as img1.jpg;'),
        ('img0.jpg,0,0\nimg1.jpg,0,0\nimg0.jpg,1,0\n', "two rows name 'img0.jpg'; leave one"),
        ('0,0,0\n1,0,0\n', 'no row names 2 of 2 query images'),
    ],
)
def test_names_that_do_not_tell_each_image_are_refused_in_one_line(tmp_path, rows, problem):
    with pytest.raises(SourceError, match=problem) as caught:
        read_positions(write(tmp_path / 'p.csv', 'image,x,y\n' + rows), 'query', NAMES[:2])
    assert '\n' not in str(caught.value)
