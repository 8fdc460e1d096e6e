# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Start vpr_node and pose_graph_node, and RViz if wanted: from a camera and odometry to a map."""

from pathlib import Path
import runpy
from typing import Any

from ament_index_python.packages import get_package_share_directory
from convseq_ros.config.arguments import local
from convseq_ros.config.parameter import parameters, refuse_unknown
from convseq_ros.config.pose_graph_config import PoseGraphConfig
from convseq_ros.errors import ConfigError
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

# Arguments of vpr.launch.py with the same name count for both nodes; the graph alone is on TF.
GRAPH = {item.name: item for item in parameters(PoseGraphConfig)}
# What a pose graph needs of vpr_node, unless it is given otherwise.
DEFAULTS = {'mode': 'online', 'closure_interval_s': '2.0'}


def generate_launch_description() -> LaunchDescription:
    """Return the arguments of both nodes, and what starts them and RViz."""
    path = Path(get_package_share_directory('convseq_ros'), 'launch', 'vpr.launch.py')
    vpr = runpy.run_path(str(path))
    known = [*vpr['TOPICS'], *vpr['OTHERS'], *vpr['PARAMETERS']]
    arguments = vpr['_arguments'](**DEFAULTS) + [
        DeclareLaunchArgument(item.name, default_value='', description=item.doc)
        for item in GRAPH.values()
        if item.name not in known
    ]
    start = OpaqueFunction(function=_nodes, args=[vpr, known, vpr['_included_with']()])
    return LaunchDescription([*arguments, start])


def _nodes(context: Any, vpr: dict[str, Any], known: list[str], names: list[str]) -> list[Node]:
    """Return the nodes, which all arguments fit: of an error launch leaves started ones alone."""
    refuse_unknown(names, [*known, *GRAPH], 'no such argument')

    def given(name: str) -> str:
        return str(LaunchConfiguration(name).perform(context))

    odom = given('odom') or vpr['_camera'](given('camera')).get('odom', '')
    if given('publish_tf').lower() == 'true':
        raise ConfigError('publish_tf: pose_graph_node broadcasts map -> odom; leave it out')
    chosen = {name: given(name) for name in GRAPH if given(name)}
    values: dict[str, Any] = {
        name: ParameterValue(GRAPH[name].parse(text), value_type=GRAPH[name].type)
        for name, text in chosen.items()
    }
    file = Path(local(given('params_file')))
    has_section = file.is_file() and 'pose_graph_node:' in file.read_text()
    values['use_sim_time'] = vpr['_is_true']('use_sim_time', context)
    graph = Node(
        package='convseq_ros',
        executable='pose_graph_node',
        name='pose_graph_node',
        namespace=given('namespace'),
        parameters=[*([str(file)] if has_section else []), values],
        remappings=[('odom', odom)] if odom else [],
        **vpr['_running'](context),
    )
    return [*vpr['_nodes'](context, []), graph]
