# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters: bounds, names, and everything that is derived from them."""

from pathlib import Path
import re

from convseq_ros.cli import main
from convseq_ros.cli.config import all_parameters, markdown, yaml
from convseq_ros.cli.options import read_parameter_file
from convseq_ros.config import (
    Config,
    EncodingConfig,
    flatten,
    make_config,
    SequenceConfig,
    with_values,
)
from convseq_ros.config.parameter import RETIRED
from convseq_ros.errors import ConfigError
from convseq_ros.evaluation.methods import make_method, parse_method
import pytest

REPOSITORY = Path(__file__).resolve().parents[1]


def test_names_are_unique_across_groups():
    names = [item.name for item in all_parameters()]
    assert len(names) == len(set(names))


def test_the_defaults_are_the_papers():
    rule = SequenceConfig()
    assert (rule.overlap_threshold, rule.entropy_threshold) == (0.9, 0.5)
    assert (rule.min_length, rule.max_overlap_length, rule.max_length) == (2, 15, 25)
    assert EncodingConfig() == EncodingConfig(512, 0.5)


def test_flat_values_round_trip():
    values = flatten(Config()) | {'max_length': 20, 'min_margin': 0.5, 'image_size_px': 256}
    assert flatten(with_values(Config(), values)) == values


@pytest.mark.parametrize(
    ('name', 'value', 'told'),
    [
        ('fixed_length', 101, r'fixed_length: 101 is outside 0 .. 100'),
        ('min_margin', -0.1, r'min_margin: -0.1 is outside 0 .. 1'),
        ('min_margin', float('nan'), 'not a finite number'),
        ('fixed_length', 2.5, 'expected int, got 2.5'),
        ('fixed_length', True, 'expected int, got True'),
        ('min_confidence', 'high', "expected float, got 'high'"),
        ('image_size_px', 500, 'multiple of 16'),
        ('acceptance_rule', 'track', "'track' is gone: set belief instead, or leave it out"),
        ('acceptance_rule', 'sum', "'sum' is not one of auto, belief, margin"),
    ],
)
def test_a_value_that_is_not_allowed_is_refused(name, value, told):
    with pytest.raises(ConfigError, match=told):
        make_config({name: value})


def test_the_shipped_parameter_file_is_what_the_code_says():
    shipped = (REPOSITORY / 'config' / 'vpr_node.yaml').read_text(encoding='utf-8')
    assert shipped == yaml(all_parameters()) + '\n'


def test_the_page_of_parameters_lists_them_as_the_code_does():
    page = REPOSITORY / 'docs' / 'PARAMETERS.md'
    assert page.read_text(encoding='utf-8') == markdown(all_parameters()) + '\n'


@pytest.mark.parametrize(('name', 'instead'), RETIRED.items())
def test_a_parameter_that_is_gone_is_refused_with_what_to_set_instead(name, instead, tmp_path):
    assert name not in {item.name for item in all_parameters()}
    told = re.escape(f"parameter '{name}' is gone: {instead}")
    with pytest.raises(ConfigError, match=told):
        make_config({name: True})
    with pytest.raises(ConfigError, match=told):
        make_method(parse_method(f'convseq+{name}=true'), make_config({}))
    path = tmp_path / 'old.yaml'
    path.write_text(f'/**:\n  ros__parameters:\n    {name}: 2\n')
    with pytest.raises(ConfigError, match=told):
        read_parameter_file(path)


@pytest.mark.parametrize('name', RETIRED)
@pytest.mark.parametrize('form', ['--{} 2', '--{}=2'])
def test_an_option_that_is_gone_is_refused_with_what_to_set_instead(name, form, capsys):
    written = form.format(name.replace('_', '-')).split()
    assert main(['replay', 'drive', '--map', 'map.db', *written]) == 1
    told = capsys.readouterr().err
    assert told == f"convseq replay: parameter '{name}' is gone: {RETIRED[name]}\n"


def test_a_folder_may_have_the_name_of_a_parameter_that_is_gone(capsys):
    assert main(['info', 'verification']) == 1
    assert 'is gone' not in capsys.readouterr().err
