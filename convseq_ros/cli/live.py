# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Plays a recording to a real node, each in a process of its own, over DDS."""

from collections.abc import Iterator
from contextlib import contextmanager
import importlib.util
import os
from pathlib import Path
import signal
import subprocess
import sys
import time

from convseq_ros.config import Config, flatten
from convseq_ros.errors import ConvseqError
from convseq_ros.results import read_results

_HIGHEST_DOMAIN = 101
_STALLED_S = 20.0


def recognise_live(
    recording: Path, frames: int, map_path: Path, folder: Path, rate: float, config: Config
) -> list[dict[str, str]]:
    """
    Return the result table that the node wrote, one row for every frame that reached it.

    Parameters
    ----------
    recording : Path
        What the player publishes; its only image topic, or a folder of images.
    frames : int
        How many images that is.
    map_path : Path
        What the node opens.
    folder : Path
        Where the table and the logs go.
    rate : float
        Seconds of the recording in a second.
    config : Config
        Given to the node parameter by parameter.

    Raises
    ------
    ConvseqError
        If ROS is absent, or one of the two processes fails.

    """
    if importlib.util.find_spec('rclpy') is None:
        raise ConvseqError("the live node needs ROS: pip install 'convseq_ros[ros]'")
    table = folder / 'live.csv'
    parameters = flatten(config) | {
        'map_path': str(map_path.absolute()),
        'result_file': str(table.absolute()),
        'queue_size': 1000,
    }
    settings = [f'{name}:={value}' for name, value in parameters.items()]
    node = ['vpr_node', '--ros-args', *(part for each in settings for part in ('-p', each))]
    with _process(node, folder) as running:
        play = ['player', str(recording), '--rate', f'{rate:g}', '--wait-subscribers', '60']
        player = subprocess.run(_command(play), env=_environment(folder), check=False)
        if player.returncode or running.poll() is not None:
            raise ConvseqError(f'the live run failed; see {folder / "vpr_node.log"}')
        _wait_for_rows(table.with_name(table.name + '.part'), frames)
    return read_results(table)


def _wait_for_rows(table: Path, wanted: int) -> None:
    """Wait until the node has worked off what it was sent, or its table stops growing."""
    rows, changed = 0, time.monotonic()
    while rows < wanted and time.monotonic() - changed < _STALLED_S:
        now = len(read_results(table)) if table.exists() else 0
        if now > rows:
            rows, changed = now, time.monotonic()
        time.sleep(0.1)


def _command(arguments: list[str]) -> list[str]:
    return [sys.executable, '-m', f'convseq_ros.node.{arguments[0]}', *arguments[1:]]


def _environment(folder: Path) -> dict[str, str]:
    """Keep the two processes among themselves."""
    return {
        **os.environ,
        'ROS_DOMAIN_ID': str(os.getpid() % (_HIGHEST_DOMAIN + 1)),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        'ROS_LOG_DIR': str(folder / 'log'),
    }


@contextmanager
def _process(arguments: list[str], folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    with (folder / f'{arguments[0]}.log').open('wb') as log:
        process = subprocess.Popen(
            _command(arguments), env=_environment(folder), stdout=log, stderr=subprocess.STDOUT
        )
        try:
            yield process
        finally:
            process.send_signal(signal.SIGINT)
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
