# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of the ROS node alone, which decide no match; written once, as in `config`."""

from dataclasses import dataclass
import math

from convseq_ros.parameter import Checked, parameter


# A table of parameters reads better in few lines.
# fmt: off
@dataclass(frozen=True, slots=True)
class NodeConfig(Checked):
    """What concerns the ROS node alone: topics, queues and files."""

    map_path: str = parameter(
        '', 'Reference map to open at start; in online mode it is made if there is none, and '
        'grows.',
    )
    save_map_path: str = parameter(
        '', 'Where ~/save_map writes a copy of the map; empty in online mode: map_path itself.',
        dynamic=True,
    )
    result_file: str = parameter('', 'CSV file to write one row per frame to; empty for none.')
    image_transport: str = parameter(
        'raw', 'Subscribe to `image` or to its `/compressed` sub-topic.',
        choices=('raw', 'compressed'),
    )
    image_reliability: str = parameter(
        'auto', 'auto asks for reliable delivery and falls back when a camera offers none.',
        choices=('auto', 'reliable', 'best_effort'),
    )
    queue_size: int = parameter(
        30, 'Frames waiting for the worker; the oldest is dropped, and counted, beyond that.',
        unit='frames', low=1, high=10000,
    )
    max_wait_s: float = parameter(
        1.0, 'A frame that has waited longer than this is dropped, and counted, for the one after '
        'it: a camera too fast for the CPU costs frames, not time; 0 lets all of them wait.',
        unit='s', low=0.0, high=3600.0,
    )
    odom_wait_s: float = parameter(
        0.05,
        'A frame waits up to this long for the odometry of its moment, if odometry comes at all.',
        unit='s',
        low=0.0,
        high=10.0,
    )
    map_frame: str = parameter('map', 'Frame in which the poses of the map are given.')
    position_sigma_m: float = parameter(
        0.5, 'Standard deviation of the positions in the map; ~/pose adds to it how far places '
        'are apart and how well neighbours score.',
        unit='m', low=0.0, high=1000.0, dynamic=True,
    )
    heading_sigma_rad: float = parameter(
        0.1, 'Standard deviation of the headings in the map; ~/pose adds 0.3 rad where the '
        'relative yaw is unknown.',
        unit='rad', low=0.0, high=math.pi, dynamic=True,
    )
    diagnostics_period_s: float = parameter(
        1.0, 'Time between two messages on /diagnostics.', unit='s', low=0.1, high=60.0,
    )
