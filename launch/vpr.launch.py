# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Start vpr_node; its topics and every parameter are arguments."""

import inspect
from pathlib import Path
import tempfile
from typing import Any

from ament_index_python.packages import get_package_share_directory
from convseq_ros.config import core_parameters
from convseq_ros.config.arguments import local
from convseq_ros.config.node_config import NodeConfig
from convseq_ros.config.parameter import Parameter, parameters, refuse_unknown
from convseq_ros.errors import ConfigError
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
import yaml

TOPICS = {
    'image': 'camera topic, raw or compressed; empty: image',
    'camera_info': 'its calibration; empty: camera_info',
    'odom': 'odometry topic; empty: odom',
}
OTHERS = {
    'camera': 'its driver, a name of config/cameras.yaml: topics as that has them',
    'method': "paper for the paper's method, config/paper.yaml; empty: as params_file says",
    'params_file': 'file of parameters; those that are arguments win',
    'namespace': 'of the node and its topics',
    'use_sim_time': 'true if a recording is played with /clock',
    'log_level': 'debug, info, warn, error or fatal',
    'respawn': 'true to start the node again 2 s after it ends',
    'rviz': 'true to open RViz with a layout of the topics',
}
PARAMETERS = {item.name: item for item in (*parameters(NodeConfig), *core_parameters())}


def generate_launch_description() -> LaunchDescription:
    """Return the node and its arguments."""
    start = OpaqueFunction(function=_nodes, args=[_included_with()])
    return LaunchDescription([*_arguments(), start])


def _arguments(**others: str) -> list[DeclareLaunchArgument]:
    """Return all arguments; `others` are defaults that are not those of the file."""
    abouts = TOPICS | OTHERS | {name: _about(item) for name, item in PARAMETERS.items()}
    defaults = {
        'params_file': str(_share() / 'config' / 'vpr_node.yaml'),
        'use_sim_time': 'false',
        'log_level': 'info',
        'respawn': 'false',
        'rviz': 'false',
        **others,
    }
    return [
        DeclareLaunchArgument(name, default_value=defaults.get(name, ''), description=about)
        for name, about in abouts.items()
    ]


def _nodes(context: Any, names: list[str]) -> list[Node]:
    """Return the nodes to start; ConfigError if an argument, of those names, is unknown."""
    refuse_unknown(names, [*TOPICS, *OTHERS, *PARAMETERS], 'no such argument')

    camera = _camera(str(LaunchConfiguration('camera').perform(context)))

    def given(name: str) -> str:
        return str(LaunchConfiguration(name).perform(context)) or camera.get(name, '')

    chosen: dict[str, Any] = {
        name: ParameterValue(item.parse(given(name)), value_type=item.type)
        for name, item in PARAMETERS.items()
        if given(name)  # else as the file of parameters says
    }
    files = [local(given('params_file'))]
    if not Path(files[0]).is_file():  # else the node starts without it
        raise ConfigError(f'params_file: {files[0]}: no such file')
    if method := given('method'):
        refuse_unknown([method], ['paper'], 'no such method')
        files.append(str(_share() / 'config' / f'{method}.yaml'))
    node = Node(
        package='convseq_ros',
        executable='vpr_node',
        name='vpr_node',
        namespace=given('namespace'),
        parameters=[*files, chosen | {'use_sim_time': _is_true('use_sim_time', context)}],
        remappings=[(name, given(name)) for name in TOPICS if given(name)],
        **_running(context),
    )
    if not _is_true('rviz', context):
        return [node]
    layout = ['-d', _layout(given('namespace'))]
    # First: where it is not installed, launch fails, and leaves alone what it has started.
    return [Node(package='rviz2', executable='rviz2', arguments=layout, output='screen'), node]


def _running(context: Any) -> dict[str, Any]:
    """Return how each node of this package is run."""
    return {
        'ros_arguments': ['--log-level', LaunchConfiguration('log_level').perform(context)],
        'respawn': _is_true('respawn', context),
        'respawn_delay': 2.0,
        'output': 'screen',
    }


def _is_true(name: str, context: Any) -> bool:
    text = str(LaunchConfiguration(name).perform(context)).lower()
    if text not in ('true', 'false', '1', '0', ''):
        raise ConfigError(f'{name}: expected true or false, got {text!r}')
    return text in ('true', '1')


def _camera(name: str) -> dict[str, str]:
    """Return the arguments for a camera's driver; ConfigError if it is unknown."""
    if not name:
        return {}
    known = yaml.safe_load((_share() / 'config' / 'cameras.yaml').read_text())
    refuse_unknown([name], known, 'no such camera')
    return dict(known[name])


def _layout(namespace: str) -> str:
    """Return the layout for RViz of a node in a namespace, a file."""
    layout = _share() / 'config' / 'convseq.rviz'
    if not (prefix := namespace.strip('/')):
        return str(layout)
    with tempfile.NamedTemporaryFile('w', suffix='.rviz', delete=False) as copy:
        text = layout.read_text().replace('/vpr_node', f'/{prefix}/vpr_node')
        copy.write(text.replace('/pose_graph_node', f'/{prefix}/pose_graph_node'))
    return copy.name


def _share() -> Path:
    return Path(get_package_share_directory('convseq_ros'))


def _about(item: Parameter) -> str:
    """Return what an argument that is a parameter is for, with its bounds and its default."""
    bounds = f'{item.bounds} {item.unit}'.strip()
    return f'{item.doc} ({f"{bounds}; " if bounds else ""}default {item.default!r})'


def _included_with() -> list[str]:
    """
    Return the names of the arguments that this file was included with.

    `ros2 launch` and other launch files include this one. Their own arguments are not told apart
    in the context, only in the action that includes it, which is on the stack now.
    """
    frame = inspect.currentframe()
    while frame:
        including = frame.f_locals.get('self')
        if type(including).__name__ == 'IncludeLaunchDescription':
            return [_plain(name) for name, _ in including.launch_arguments]
        frame = frame.f_back
    return []


def _plain(name: Any) -> str:
    """Return a name as Python writes it, or XML: there it is a list of substitutions."""
    return name if isinstance(name, str) else ''.join(part.text for part in name)
