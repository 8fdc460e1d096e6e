# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which sections of a ROS parameter file a command reads: those that a node would read."""

from convseq_ros.cli.parameter_file import read_parameter_file
from convseq_ros.errors import ConfigError
import pytest


@pytest.fixture
def read(tmp_path):
    """Return a function that reads a parameter file; P1, P2 and P3 of its text are sections."""

    def read(text):
        for number in range(1, 4):
            text = text.replace(f'P{number}', f'{{ros__parameters: {{fixed_length: {number}}}}}')
        (tmp_path / 'my.yaml').write_text(text)
        return read_parameter_file(tmp_path / 'my.yaml')

    return read


@pytest.mark.parametrize(
    'text',
    [
        'vpr_node: P3',
        '/robot1/vpr_node: P3',
        'robot1: {vpr_node: P3}',
        'robot1: {front: {vpr_node: P3}}',
        'front_vpr: P3',
        '/**: P1\nfront_vpr: P3',
        '/*: P1\n/**/vpr_node: P2\nvpr_node: P3',
        '/*/vpr_node: P1\nrobot1: {"**": P2}\n/robot1/vpr_node: P3',
        'vpr_node: P1\n/**: P3',  # the last one of the file wins, as in ROS
        'vpr_node: P3\nekf_node: {ros__parameters: {mode: 2d, frequency: 30.0}}',
    ],
)
def test_sections_of_one_node_are_read_in_the_order_of_the_file(read, text):
    assert read(text) == {'fixed_length': 3}


@pytest.mark.parametrize(
    ('text', 'told'),
    [
        (
            '/robot1/vpr_node: P1\n/robot2/vpr_node: P2',
            '(/robot1/vpr_node, /robot2/vpr_node); leave',
        ),
        ('robot1: {vpr_node: P1}\nrobot2: {vpr_node: P2}', '(/robot1/vpr_node, /robot2/vpr_node)'),
        ('vpr_node: P1\nfront_vpr: P2', 'sections of several nodes (/vpr_node, /front_vpr)'),
        ('/**: P1\n/robot1/**: P2', '(/vpr_node, /robot1/**)'),
        ('/robot1/*: P1\n/vpr_node: P2', '(/vpr_node, /robot1/*)'),
        (
            'a: {ekf: {ros__parameters: {mode: 2d, rate: 3}}}\nb: {ros__parameters: {}}',
            'vpr_node or /**, but with /a/ekf, /b; `convseq',
        ),
        ('ros__parameters: {fixed_length: 3}', 'not a ROS parameter file'),
        ('fixed_length: 3', 'not a ROS parameter file'),
        ('/**: {ros__parameters: {fixed_lenght: 3}}', 'did you mean fixed_length?'),
        ('/**:\n  ros__parameters: 3', 'not a ROS parameter file'),
        ('{', 'not YAML'),
        ('/**: {a: 1, b: 2, a: 1}', "has 'a' 2 times; leave one"),
        ('/**: &own\n  ros__parameters: *own', 'has an alias'),
        ('[' * 1_000, 'nested too deeply'),
        (f'/**:\n  ros__parameters: {{threads: 0x{"f" * 4000}}}', 'not YAML'),
        ('# ' * 200_000, 'set max_file_mb to 409.6'),
        ('- 1', 'not a list of'),
    ],
)
def test_a_file_that_no_single_node_would_read_is_refused_in_one_line(read, text, told):
    with pytest.raises(ConfigError) as refused:
        read(text)
    assert told in str(refused.value) and '\n' not in str(refused.value)
