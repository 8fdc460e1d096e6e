# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Plays a recording to a real node, each in a process of its own, over DDS."""

from pathlib import Path
import subprocess
import sys

from convseq_ros.cli.processes import (
    environment,
    need_ros,
    player_arguments,
    running,
    wait_for_rows,
)
from convseq_ros.config import Config, core_parameters, flatten
from convseq_ros.errors import ConvseqError
from convseq_ros.parameter import parameters as parameters_of
from convseq_ros.reading_config import ReadingConfig
from convseq_ros.results import read_results

_END_S = 10.0
_STALLED_S = 20.0


def recognise_live(
    recording: Path,
    frames: int,
    map_path: Path,
    folder: Path,
    rate: float,
    config: Config,
    *,
    odom: str = '',
    camera_info: str = '',
) -> list[dict[str, str]]:
    """
    Return the result table that the node wrote, one row for every frame that reached it.

    The player publishes the recording, its only image topic or a folder, of so many `frames`, and
    its topics `odom` and `camera_info`; `rate` is how many seconds of it are in a second. The node
    gets the configuration parameter by parameter; tables and logs go to a folder. ConvseqError if
    ROS is not there, or one of the processes fails.
    """
    need_ros()
    table = folder / 'live.csv'
    values = flatten(config)
    parameters = {item.name: values[item.name] for item in core_parameters()} | {
        'map_path': str(map_path.absolute()),
        'result_file': str(table.absolute()),
        'queue_size': 1000,
        'max_wait_s': 0.0,
        'odom_wait_s': 2.0,
    }
    # ROS cannot parse an empty text, which is the default of those that have it.
    settings = [f'{name}:={value}' for name, value in parameters.items() if value != '']
    node = [
        '-m',
        'convseq_ros.node.vpr_node',
        '--ros-args',
        *(part for each in settings for part in ('-p', each)),
    ]
    limits = [
        f'--{item.name.replace("_", "-")}={getattr(config.reading, item.name)}'
        for item in parameters_of(ReadingConfig)
    ]
    player = [sys.executable, *player_arguments(recording, rate, odom, camera_info), *limits]
    with running('vpr_node', node, folder, _END_S) as process:
        played = subprocess.run(player, env=environment(folder), check=False)
        if played.returncode or process.poll() is not None:
            raise ConvseqError(f'the live run failed; see {folder / "vpr_node.log"}')
        wait_for_rows(table, frames, _STALLED_S)
    return read_results(table)
