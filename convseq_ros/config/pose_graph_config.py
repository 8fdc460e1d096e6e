# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of `pose_graph_node`; written once, as in `config`."""

from dataclasses import dataclass

from convseq_ros.config.parameter import Checked, parameter


# A table of parameters reads better in few lines.
# fmt: off
@dataclass(frozen=True, slots=True)
class PoseGraphConfig(Checked):
    """Settings of the pose graph: frames, files and the errors of what it is told."""

    map_frame: str = parameter('map', 'TF frame of the corrected poses.', is_frame=True)
    base_frame: str = parameter(
        'base_link', 'TF frame of the robot, to which static TF carries odometry.', is_frame=True,
    )
    publish_tf: bool = parameter(
        True, 'Whether map -> odom is on /tf, where tf2_msgs is installed; it is always on '
        '~/map_to_odom.',
    )
    map_path: str = parameter(
        '', 'Map file of vpr_node, which is only read: the graph begins with its drives; empty '
        'for none.',
        is_path=True,
    )
    tum_file: str = parameter(
        '', 'File to which ~/save and the end write the keyframes as TUM; empty for none.',
        is_path=True, dynamic=True,
    )
    g2o_file: str = parameter(
        '', 'File to which ~/save and the end write the graph as g2o, beside FILE.csv with the '
        'times of its vertices; empty for none.',
        is_path=True, dynamic=True,
    )
    graph_spacing_m: float = parameter(
        2.0, 'Distance between two keyframes of the graph, or a turn of 20 degrees.',
        unit='m', low=0.01, high=1000.0,
    )
    odometry_sigma_m: float = parameter(
        0.15, 'Standard deviation of odometry after one metre, growing with the square root of '
        'the distance, where messages bring no growing covariance.',
        unit='m', low=1e-6, high=100.0,
    )
    odometry_sigma_rad: float = parameter(
        0.01, 'The same for the heading.', unit='rad', low=1e-6, high=3.0,
    )
    closure_sigma_m: float = parameter(
        1.5, 'Standard deviation of the distance between two visits of a place that was not '
        'measured.', unit='m', low=0.001, high=1000.0,
    )
    closure_sigma_rad: float = parameter(
        0.15, 'The same for the heading, where that is not measured.',
        unit='rad', low=0.001, high=3.0,
    )
    period_s: float = parameter(
        1.0, 'Time in which closures are collected before the graph is solved.',
        unit='s', low=0.01, high=3600.0,
    )
# fmt: on
