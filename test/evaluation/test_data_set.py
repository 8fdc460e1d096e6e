# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Data sets as YAML: what is understood, and what is refused in one line."""

from convseq_ros.errors import ConfigError, ConvseqError, SourceError
from convseq_ros.evaluation.data_set import open_data_set, ready_made
import pytest


def test_paths_start_at_the_file(street):
    data_set = open_data_set(str(street.file))
    assert data_set.name == 'street'
    assert data_set.query.path == street.folder / 'query'
    assert data_set.reference.path == street.folder / 'reference'
    assert not data_set.online


def test_the_sets_of_the_paper_are_ready_made_and_say_where_their_images_belong(tmp_path):
    names = 'alderley campus_loop corridor gardens_point_day_day gardens_point_day_night nordland'
    assert {*names.split()} <= set(ready_made())
    for name in ready_made():
        data_set = open_data_set(name, tmp_path)
        if data_set.query.simulated:
            continue
        assert data_set.query.path.is_relative_to(tmp_path)
        assert 'DATA/' in data_set.where
        assert data_set.source


def test_missing_images_of_a_ready_made_set_are_asked_for(tmp_path, street):
    from convseq_ros.config import EncodingConfig
    from convseq_ros.evaluation.material import open_material

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
        (yaml(query='{topic: /a}'), 'query: has no path'),
        (yaml(query='query'), 'query is not a list'),
        (yaml(query='{path: query, topic: /a /b}'), "'/a /b' names several cameras"),
        (yaml(truht='{}'), "unknown key 'truht'; did you mean truth"),
        (yaml(truth='{kind: exact}'), "truth: kind 'exact' is not one of identity"),
        (yaml(truth='{kind: table}'), 'truth: table has no path'),
        (yaml(truth='{kind: poses}'), 'truth: poses has no radius_m'),
        (
            yaml(truth='{kind: identity, tolerance: -1}'),
            'truth: tolerance, radius_m and first_index are not below 0',
        ),
        (yaml(truth='{kind: identity, tolerance: two}'), "tolerance: 'two' is not a number"),
        (yaml(reference=''), 'truth identity needs a reference'),
        (yaml(name='a/b'), "name 'a/b' is no folder name"),
        ('- a', 'the file is not a list'),
        ('a: [', 'not YAML'),
    ],
)
def test_what_cannot_be_understood_is_refused_in_one_line(street, text, problem):
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
        (yaml(truth='{kind: table, path: empty.csv}'), 'gives no query a right reference'),
        (yaml(truth=POSES), '1 positions for 24 query'),
        (yaml(query='{path: query, backwards: true}', truth=POSES), 'poses cannot go backwards'),
    ],
)
def test_a_set_whose_parts_disagree_is_refused_in_one_line(street, text, problem):
    street.write('query,reference\n0,99\n', 'gt.csv')
    street.write('query,reference\n', 'empty.csv')
    street.write('drive,x,y\nquery,0,0\n', 'poses.csv')
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
