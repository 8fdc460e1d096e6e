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
        '', 'Map file to open at the start; online mode makes it if there is none, and adds.',
    )
    save_map_path: str = parameter(
        '', 'File to which ~/save_map writes a copy of the map; empty in online mode: map_path.',
        dynamic=True,
    )
    result_file: str = parameter('', 'CSV file that gets a row for every frame; empty for none.')
    fleet: str = parameter(
        '', 'Scheduler whose maps (convseq fleet serve) are asked beside the own map, such as '
        'tcp://127.0.0.1:8786; answers on ~/fleet_answer. Empty for none.',
    )
    fleet_tls: str = parameter(
        '', 'Folder of ca.pem, cert.pem and key.pem, for a fleet that is on another machine.',
    )
    fleet_timeout_s: float = parameter(
        1.0, 'A fleet that does not answer within this time is given up, and looked for again.',
        unit='s', low=0.05, high=60.0,
    )
    image_topics: str = parameter(
        '', 'Image topics of several cameras, with spaces between, each with its camera_info '
        'beside it; the first alone adds to a map. Empty for one camera, on topic `image`.',
    )
    image_transport: str = parameter(
        'raw', 'Images to subscribe to: raw on topic `image`, compressed on `image/compressed`.',
        choices=('raw', 'compressed'),
    )
    image_reliability: str = parameter(
        'auto', 'Delivery of images: auto asks for reliable and falls back where a camera offers '
        'only best_effort.',
        choices=('auto', 'reliable', 'best_effort'),
    )
    queue_size: int = parameter(
        30, 'Most frames that wait for their turn; beyond that the oldest is dropped and counted.',
        unit='frames', low=1, high=10000,
    )
    queue_mb: float = parameter(
        256.0, 'Most memory of the frames that wait; beyond it, too, the oldest is dropped and '
        'counted. The middleware keeps as much again.',
        unit='MB', low=1.0, high=100000.0,
    )
    max_wait_s: float = parameter(
        1.0, 'A frame that has waited longer than this is dropped and counted, so that a camera '
        'too fast for the CPU costs frames, not time; 0 drops none.',
        unit='s', low=0.0, high=3600.0,
    )
    odom_wait_s: float = parameter(
        0.05, 'A frame waits at most this long for odometry of its moment, if there is odometry.',
        unit='s', low=0.0, high=10.0,
    )
    depth_topic: str = parameter(
        '', 'Topic of depth images registered to the camera (16UC1 in mm or 32FC1 in m): a map '
        'keeps how deep its places are, so that poses need no odometry. Empty for none.',
    )
    base_frame: str = parameter(
        'base_link', 'TF frame of the robot (REP-105), whose poses ~/pose and ~/closure tell; TF '
        'from it to the frame of camera_info says where the camera is.',
    )
    map_frame: str = parameter('map', 'TF frame of the poses in the map.')
    position_sigma_m: float = parameter(
        0.5, 'Standard deviation of the positions in the map; ~/pose adds what the spacing of '
        'places and the scores of neighbours leave open.',
        unit='m', low=0.0, high=1000.0, dynamic=True,
    )
    heading_sigma_rad: float = parameter(
        0.1, 'Standard deviation of the headings in the map; ~/pose adds 0.3 rad where the camera '
        'is not known.',
        unit='rad', low=0.0, high=math.pi, dynamic=True,
    )
    localize_timeout_s: float = parameter(
        10.0, '~/localize answers after this time at the latest, with the reason why the robot is '
        'not localised.', unit='s', low=0.0, high=3600.0, dynamic=True,
    )
    publish_initial_pose: bool = parameter(
        False, 'Whether one pose goes to the topic `initialpose` each time that the robot was '
        'lost and is localised, if the map has poses.',
    )
    lifecycle: bool = parameter(
        False, 'Whether the node waits to be configured and activated by ~/change_state '
        '(lifecycle_msgs) instead of starting at once.',
    )
    diagnostics_period_s: float = parameter(
        1.0, 'Time between two messages on /diagnostics.', unit='s', low=0.1, high=60.0,
    )
