# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters: bounds, names, and everything that is derived from them."""

from pathlib import Path
from runpy import run_path

from convseq_ros.cli.config import all_parameters, PAPERS, yaml
from convseq_ros.cli.parameter_file import read_parameter_file
from convseq_ros.config import Config, flatten, make_config, with_values
from convseq_ros.config.node_config import NodeConfig
from convseq_ros.config.paper import PAPER, paper_parameters
from convseq_ros.config.pose_graph_config import PoseGraphConfig
from convseq_ros.errors import ConfigError
import numpy as np
import pytest

REPOSITORY = Path(__file__).resolve().parents[1]


def test_names_are_unique_across_groups():
    names = [item.name for item in all_parameters()]
    assert len(names) == len(set(names))


def test_flat_values_round_trip():
    values = flatten(Config()) | {'max_length': 20, 'min_margin': 0.5, 'image_size_px': 256}
    assert flatten(with_values(Config(), values)) == values


REFUSED = [
    ('fixed_length', 101, r'fixed_length: 101 is outside 0 .. 100'),
    ('min_margin', -0.1, r'min_margin: -0.1 is outside 0 .. 1'),
    ('min_margin', float('nan'), 'not a finite number'),
    ('min_margin', 10**400, 'min_margin: expected float'),
    ('fixed_length', 2.5, 'expected int, got 2.5'),
    ('fixed_length', True, 'expected int, got True'),
    ('min_confidence', 'high', "expected float, got 'high'"),
    ('image_size_px', 500, 'multiple of 16'),
    ('image_rotation_deg', 45, 'image_rotation_deg: 45 is not a multiple of 90'),
    ('acceptance_rule', 'sum', "'sum' is not one of auto, belief, margin, always"),
    ('min_length', 30, 'min_length: 30 is above max_length, 25'),
    ('sequence_regions', 'newest', 'newest needs matching: regional, not coherent'),
    *(
        ('camera_to_base', said, r'camera_to_base: .*semicolon')
        for said in ('1 2 3', '0 0 0 0 0 0;', '0 0 0 0 0 0; a b c d e f')
    ),
]


@pytest.mark.parametrize(('name', 'value', 'told'), REFUSED)
def test_a_value_that_is_not_allowed_is_refused(name, value, told):
    with pytest.raises(ConfigError, match=told):
        make_config({name: value})


@pytest.mark.parametrize(
    ('name', 'value', 'kind'),
    [('fixed_length', np.int64(3), int), ('min_confidence', np.float32(0.5), float)],
)
def test_numbers_of_numpy_are_taken_as_those_of_python(name, value, kind):
    assert type(flatten(make_config({name: value}))[name]) is kind


@pytest.mark.parametrize(
    ('group', 'name'),
    [(NodeConfig, 'map_frame'), (NodeConfig, 'base_frame'), (PoseGraphConfig, 'map_frame')],
)
def test_a_frame_has_a_name_and_no_slash_of_ros_1_before_it(group, name):
    for value in ' ', '/':
        with pytest.raises(ConfigError, match=f'{name}: names no TF frame; the default is '):
            group(**{name: value})
    assert getattr(group(**{name: '/robot1/x'}), name) == 'robot1/x'  # as TF 2 has it


def test_the_shipped_parameter_file_holds_the_defaults_of_the_code():
    shipped = (REPOSITORY / 'config' / 'vpr_node.yaml').read_text(encoding='utf-8')
    assert shipped == yaml(all_parameters()) + '\n'


def test_the_papers_parameter_file_holds_the_papers_settings():
    shipped = (REPOSITORY / 'config' / 'paper.yaml').read_text(encoding='utf-8')
    assert shipped == yaml(paper_parameters(), PAPERS) + '\n'
    values = read_parameter_file(REPOSITORY / 'config' / 'paper.yaml')
    assert make_config(values) == with_values(Config(), PAPER)
    default = flatten(Config())
    assert {name for name in values if values[name] != default[name]} == set(PAPER)


def test_the_page_of_parameters_lists_them_as_the_code_does():
    docs = REPOSITORY / 'docs'
    made = run_path(str(docs / 'make_parameters.py'))['page']()
    assert (docs / 'PARAMETERS.md').read_text(encoding='utf-8') == made + '\n'
