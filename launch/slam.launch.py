# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Start vpr_node and pose_graph_node, and RViz if wanted: from a camera and odometry to a map."""

from pathlib import Path
import runpy
from typing import Any

from ament_index_python.packages import get_package_share_directory
from convseq_ros.config.parameter import parameters, refuse_unknown
from convseq_ros.config.pose_graph_config import PoseGraphConfig
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

# Arguments of vpr.launch.py with the same name count for both nodes; the graph alone is on TF.
GRAPH = {item.name: item for item in parameters(PoseGraphConfig) if item.name != 'publish_tf'}
# What a pose graph needs of vpr_node, unless it is given otherwise.
DEFAULTS = {'mode': 'online', 'closure_interval_s': '2.0'}


def generate_launch_description() -> LaunchDescription:
    """Return the arguments, vpr_node and RViz by their own launch file, and pose_graph_node."""
    path = Path(get_package_share_directory('convseq_ros'), 'launch', 'vpr.launch.py')
    vpr = runpy.run_path(str(path))
    known = [*vpr['TOPICS'], *vpr['OTHERS'], *vpr['PARAMETERS']]
    own = [item for item in GRAPH.values() if item.name not in known]
    refuse_unknown(vpr['_included_with'](), [*known, *GRAPH], 'no such argument')
    arguments = [
        DeclareLaunchArgument(item.name, default_value='', description=item.doc) for item in own
    ]
    # Whatever else is given reaches the included file, too.
    included = IncludeLaunchDescription(
        PythonLaunchDescriptionSource(str(path)),
        launch_arguments=[
            (name, LaunchConfiguration(name, default=value)) for name, value in DEFAULTS.items()
        ],
    )
    return LaunchDescription([*arguments, included, OpaqueFunction(function=_graph)])


def _graph(context: Any) -> list[Node]:
    """Return pose_graph_node, once it is known which arguments were given."""

    def given(name: str) -> str:
        return str(LaunchConfiguration(name, default='').perform(context))

    if given('publish_tf').lower() == 'true':
        raise ValueError('publish_tf: pose_graph_node broadcasts map -> odom; leave it out')
    chosen = {name: given(name) for name in GRAPH if given(name)}
    if given('map_path') and 'graph_file' not in chosen:
        chosen['graph_file'] = given('map_path') + '.graph'
    values: dict[str, Any] = {
        name: ParameterValue(GRAPH[name].parse(text), value_type=GRAPH[name].type)
        for name, text in chosen.items()
    }
    values['use_sim_time'] = given('use_sim_time').lower() in ('true', '1')
    graph = Node(
        package='convseq_ros',
        executable='pose_graph_node',
        name='pose_graph_node',
        namespace=given('namespace'),
        parameters=[values],
        remappings=[('odom', given('odom'))] if given('odom') else [],
        output='screen',
    )
    return [graph]
