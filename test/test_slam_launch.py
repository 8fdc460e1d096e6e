# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""slam.launch.py starts what its arguments say; `launch`, which PyPI has not, is recorded."""

from pathlib import Path
import runpy

from convseq_ros.errors import ConfigError
import pytest
from recorded_launch import generator_of, record_launch

LAUNCH = Path(__file__).resolve().parents[1] / 'launch' / 'slam.launch.py'


@pytest.fixture
def launched(monkeypatch):
    """Return what makes the parameters of vpr_node and all nodes of given arguments."""
    record_launch(monkeypatch, str(LAUNCH.parents[1]))

    def make(**given):
        *declared, start = generator_of(LAUNCH)().args[0]
        context = {one.args[0]: one.kwargs['default_value'] for one in declared} | given
        nodes = start.kwargs['function'](context, *start.kwargs['args'])
        *_, vpr, graph = [node.kwargs for node in nodes]
        return vpr['parameters'][-1], graph

    return make


def test_without_arguments_a_map_is_made_online(launched):
    chosen, graph = launched()
    assert chosen['mode'] == 'online' and chosen['closure_interval_s'] == 2.0
    assert graph['executable'] == 'pose_graph_node'
    assert graph['parameters'] == [{'use_sim_time': False}]
    assert graph['remappings'] == []
    chosen, graph = launched(publish_tf='false')
    assert not chosen['publish_tf'] and graph['parameters'][0]['publish_tf'] is False


def test_both_nodes_get_the_map_and_the_graphs_parameters_are_arguments(launched):
    chosen, graph = launched(
        map_path='home.db', mode='preloaded', odom='/wheels', use_sim_time='true',
        namespace='robot1', odometry_sigma_m='0.2', map_frame='site', respawn='true',
        log_level='debug',
    )  # fmt: skip
    assert chosen['mode'] == 'preloaded' and chosen['map_frame'] == 'site'
    assert chosen['map_path'] == 'home.db'
    assert graph['respawn'] and graph['ros_arguments'] == ['--log-level', 'debug']
    assert graph['parameters'] == [
        {'map_frame': 'site', 'map_path': 'home.db', 'odometry_sigma_m': 0.2,
         'use_sim_time': True}
    ]  # fmt: skip
    assert graph['remappings'] == [('odom', '/wheels')] and graph['namespace'] == 'robot1'
    assert launched(camera='zed')[1]['remappings'] == [('odom', 'zed/zed_node/odom')]


def test_rviz_shows_the_corrected_path_in_the_namespace(launched):
    included = runpy.run_path(str(LAUNCH.with_name('vpr.launch.py')))
    text = Path(included['_layout']('/robot1')).read_text()
    assert '/robot1/vpr_node/markers' in text and '/robot1/pose_graph_node/path' in text
    assert ' /vpr_node/' not in text and ' /pose_graph_node/' not in text


@pytest.mark.parametrize(
    ('name', 'text', 'told'),
    [
        ('params_file', '/none.yaml', '/none.yaml: no such file'),
        ('use_sim_time', 'maybe', "expected true or false, got 'maybe'"),
        ('respawn', 'yes', "expected true or false, got 'yes'"),
        ('publish_tf', 'true', 'pose_graph_node broadcasts map -> odom'),
    ],
)
def test_an_argument_of_launch_that_has_no_effect_is_refused(launched, name, text, told):
    with pytest.raises(ConfigError, match=f'{name}: {told}'):
        launched(**{name: text})


def test_a_file_of_parameters_counts_for_the_graph_if_it_names_that(
    launched, tmp_path, monkeypatch
):
    file = tmp_path / 'both.yaml'
    file.write_text('vpr_node: {}')
    assert launched(params_file=str(file))[1]['parameters'] == [{'use_sim_time': False}]
    file.write_text('vpr_node: {}\npose_graph_node: {}')
    monkeypatch.setenv('HOME', str(tmp_path))
    assert launched(params_file='~/both.yaml')[1]['parameters'][0] == str(file)
