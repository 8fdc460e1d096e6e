# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Start vpr_node with a map, or to make one, listening to one camera and its odometry."""

from pathlib import Path
import sys
from typing import Any

from ament_index_python.packages import get_package_share_directory
from convseq_ros.config.parameter import RETIRED
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

TOPICS = {
    'image': 'camera topic, raw or compressed; empty: the best one in the namespace',
    'camera_info': 'its calibration; empty: beside the camera topic',
    'odom': 'odometry topic; empty: the only one in the namespace',
}
# Empty ones leave what the file of parameters says.
PARAMETERS = {
    'map_path': 'map to open; online mode makes it if there is none, and adds to it',
    'mode': 'preloaded: recognise the places of a map; online: also add to it',
}
OTHERS = {
    'params_file': 'file of all other parameters',
    'namespace': 'of the node and its topics',
    'use_sim_time': 'true if a recording is played with /clock',
}
ARGUMENTS = TOPICS | PARAMETERS | OTHERS


def generate_launch_description() -> LaunchDescription:
    """Return the node and its arguments."""
    _refuse_unknown()
    share = Path(get_package_share_directory('convseq_ros'))
    defaults = {'params_file': str(share / 'config' / 'vpr_node.yaml'), 'use_sim_time': 'false'}
    arguments = [
        DeclareLaunchArgument(name, default_value=defaults.get(name, ''), description=text)
        for name, text in ARGUMENTS.items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=_node)])


def _node(context: Any) -> list[Node]:
    """Return the node, once it is known which arguments were given."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    topics = {name: given[name] for name in TOPICS if given[name]}
    parameters: dict[str, Any] = {
        name: ParameterValue(given[name], value_type=str) for name in PARAMETERS if given[name]
    }
    parameters['use_sim_time'] = given['use_sim_time'].lower() in ('true', '1')
    node = Node(
        package='convseq_ros',
        executable='vpr_node',
        name='vpr_node',
        namespace=given['namespace'],
        parameters=[given['params_file'], parameters],
        remappings=list(topics.items()),
        output='screen',
    )
    return [node]


def _refuse_unknown() -> None:
    """Raise ValueError for arguments that `ros2 launch` was given for this file and has not."""
    here = [at for at, word in enumerate(sys.argv) if Path(word).name == Path(__file__).name]
    words = sys.argv[here[0] :] if here else []  # another launch file has arguments of its own
    given = [word for word in words if ':=' in word]
    names = [word.partition(':=')[0] for word in given]
    if gone := [name for name in names if name in RETIRED]:
        raise ValueError(f'parameter {gone[0]!r} is gone: {RETIRED[gone[0]]}')
    unknown = [word for word in given if word.partition(':=')[0] not in ARGUMENTS]
    if unknown:
        raise ValueError(
            f'no such argument: {", ".join(unknown)}; there are {", ".join(ARGUMENTS)}'
        )
