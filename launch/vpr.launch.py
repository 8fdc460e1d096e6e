# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Start vpr_node with one file of parameters, listening to one camera and its odometry."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description() -> LaunchDescription:
    """Return the node and its arguments: a file of parameters, and three topics."""
    defaults = Path(get_package_share_directory('convseq_ros'), 'config', 'vpr_node.yaml')
    image = LaunchConfiguration('image')
    return LaunchDescription(
        [
            DeclareLaunchArgument('params_file', default_value=str(defaults)),
            DeclareLaunchArgument('image', default_value='image', description='camera topic'),
            DeclareLaunchArgument(
                'camera_info', default_value='camera_info', description='its calibration'
            ),
            DeclareLaunchArgument('odom', default_value='odom', description='odometry topic'),
            Node(
                package='convseq_ros',
                executable='vpr_node',
                name='vpr_node',
                parameters=[LaunchConfiguration('params_file')],
                remappings=[
                    ('image', image),
                    ('image/compressed', [image, '/compressed']),
                    ('camera_info', LaunchConfiguration('camera_info')),
                    ('odom', LaunchConfiguration('odom')),
                ],
                output='screen',
            ),
        ]
    )
