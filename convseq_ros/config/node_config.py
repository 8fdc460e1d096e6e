# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of the ROS node that do not affect a match; written once, as in `config`."""

from dataclasses import dataclass
import re

from convseq_ros.config.parameter import Checked, parameter
from convseq_ros.errors import ConfigError

_TOPIC = re.compile(r'(~/|/)?[A-Za-z_]\w*(/[A-Za-z_]\w*)*', re.ASCII)


# A table of parameters reads better in few lines.
# fmt: off
@dataclass(frozen=True, slots=True)
class NodeConfig(Checked):
    """Settings of the ROS node: topics, queues and files."""

    map_path: str = parameter(
        '', 'Map file to open at the start; online mode creates it if it does not exist.',
        is_path=True,
    )
    save_map_path: str = parameter(
        '', 'File to which ~/save_map writes a copy; if empty, online mode saves to map_path.',
        dynamic=True, is_path=True,
    )
    result_file: str = parameter(
        '', 'CSV file that gets a row for every frame; empty for none.', is_path=True,
    )
    image_topics: str = parameter(
        '', 'Image topics of several cameras, separated by spaces; only the first adds places; '
        'empty for one camera on `image`.',
    )
    queue_size: int = parameter(
        30, 'Most waiting frames; beyond it the oldest is dropped and counted.',
        unit='frames', low=1, high=10000, dynamic=True,
    )
    max_wait_s: float = parameter(
        1.0, 'A frame that has waited longer is dropped and counted; 0 drops none.',
        unit='s', low=0.0, high=3600.0, dynamic=True,
    )
    odom_wait_s: float = parameter(
        0.05, 'Longest time that a frame waits for odometry at its stamp.',
        unit='s', low=0.0, high=10.0, dynamic=True,
    )
    base_frame: str = parameter(
        'base_link', 'TF frame of the robot, whose pose ~/pose and ~/closure report.',
        is_frame=True,
    )
    map_frame: str = parameter('map', 'TF frame of the poses in the map.', is_frame=True)
    position_sigma_m: float = parameter(
        0.5, 'Standard deviation of positions in the map, unless the map tells a larger one.',
        unit='m', low=0.0, high=1000.0, dynamic=True,
    )
    heading_sigma_rad: float = 0.1  # the same for headings
    localize_timeout_s: float = parameter(
        10.0, 'Longest time until ~/localize answers.',
        unit='s', low=0.0, high=3600.0, dynamic=True,
    )
    publish_initial_pose: bool = parameter(
        False, 'Whether initialpose gets a pose each time the robot was lost and is localised.',
        dynamic=True,
    )
    publish_tf: bool = parameter(
        False, 'Whether map -> odom is on /tf and ~/map_to_odom; for a preloaded map with poses, '
        'where nothing else publishes it.',
    )
    lifecycle: bool = parameter(
        False, 'Whether the node waits for ~/change_state (lifecycle_msgs).',
    )
    diagnostics_period_s: float = parameter(
        1.0, 'Time between two messages on /diagnostics.',
        unit='s', low=0.1, high=60.0, dynamic=True,
    )
    # fmt: on

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        for topic in self.image_topics.split():
            if not _TOPIC.fullmatch(topic):
                raise ConfigError(
                    f'image_topics: {topic!r} is no name of a topic; give one such as '
                    '/camera/image_raw'
                )
