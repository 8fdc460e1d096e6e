# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Runs nodes as separate processes in a private ROS domain, and reads their result table."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from importlib.util import find_spec
import os
from pathlib import Path
import signal
import socket
import subprocess
import sys
import time

from convseq_ros.errors import ConvseqError, NEEDS_ROS
from convseq_ros.io.results import read_results
from convseq_ros.node.process import fast_dds, LARGE_IMAGES

# Topics of drawn recordings.
IMAGE, ODOM, CAMERA_INFO = '/camera/image_raw', '/odom', '/camera/camera_info'
# A busy machine loses no frame.
PATIENT: dict[str, object] = {'queue_size': 1000, 'max_wait_s': 0.0, 'odom_wait_s': 2.0}
_END_S = 10.0
_STALLED_S = 20.0


def recognise_live(
    recording: Path, frames: int, map_path: Path, folder: Path, rate: float
) -> list[dict[str, str]]:
    """
    Return the result table that the node wrote, one row for every frame that reached it.

    It is sent a recording of `frames` images at `rate` times its speed. Tables and logs go to
    `folder`. ConvseqError if ROS is not installed, or a process fails.
    """
    need_ros()
    table = folder / 'live.csv'
    table.unlink(missing_ok=True)  # of an earlier demo; the node would keep it
    files = {'map_path': map_path.absolute(), 'result_file': table.absolute()}
    node = node_arguments('vpr_node', PATIENT | files)
    sender = sender_arguments(recording, rate)
    with (
        running('vpr_node', node, folder, _END_S) as process,
        running('drive_sender', sender, folder, _END_S) as sending,
    ):
        if sending.wait() or process.poll() is not None:
            raise ConvseqError(f'the live run failed; see {folder}/*.log')
        wait_for_rows(table, frames, _STALLED_S)
    return read_results(table)


_HIGHEST_DOMAIN = 101
_POLL_S = 0.1


@cache
def own_domain() -> int:
    """Claim a ROS domain for this process alone; ConvseqError if all of them are in use."""
    for number in range(_HIGHEST_DOMAIN):
        domain = 1 + (os.getpid() + number) % _HIGHEST_DOMAIN
        claim = socket.socket(socket.AF_UNIX)
        try:
            # An abstract name instead of a file: it is free again when the process ends.
            claim.bind(f'\0convseq_ros_domain_{domain}')
        except OSError:
            claim.close()
            continue
        claim.detach()
        return domain
    raise ConvseqError(
        f'all ROS domains, 1 to {_HIGHEST_DOMAIN}, are in use; end another live run'
    )


def environment(folder: Path) -> dict[str, str]:
    """Return an environment in which this process's children see each other and nobody else."""
    return {
        **os.environ,
        **fast_dds(LARGE_IMAGES),
        'ROS_DOMAIN_ID': str(own_domain()),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        'ROS_LOG_DIR': str(folder / 'log'),
    }


def need_ros(user: str = '') -> None:
    """Raise a ConvseqError that says how to install ROS, which `user` needs, if it is missing."""
    if find_spec('rclpy') is None:
        raise ConvseqError(f'{user}: {NEEDS_ROS}' if user else NEEDS_ROS)


def node_arguments(name: str, settings: Mapping[str, object]) -> list[str]:
    """Return Python's arguments to run a node with parameters."""
    words = (word for key in settings for word in ('-p', f'{key}:={settings[key]}'))
    return ['-m', f'convseq_ros.node.{name}', '--ros-args', *words]


def sender_arguments(recording: Path, rate: float) -> list[str]:
    """Return Python's arguments to send a drawn recording, with all its topics, to nodes."""
    names = f'{ODOM}:=/odom', f'{CAMERA_INFO}:=/camera_info', f'{IMAGE}:=/image'
    return ['-m', 'convseq_ros.node.outputs.drive_sender', str(recording), f'{rate:g}', *names]


@contextmanager
def running(
    name: str, arguments: Sequence[str], folder: Path, end_s: float
) -> Iterator[subprocess.Popen[bytes]]:
    """Run Python, with a log `<name>.log`, until the block ends; then end it as Ctrl-C does."""
    with (folder / f'{name}.log').open('wb') as log:
        process = subprocess.Popen(
            [sys.executable, *arguments],
            env=environment(folder),
            stdout=log,
            stderr=subprocess.STDOUT,
        )
        try:
            yield process
        finally:
            end(process, end_s)


def end(process: subprocess.Popen[bytes], end_s: float) -> None:
    """Ask a process to end as Ctrl-C does; kill it if it takes longer than that."""
    process.send_signal(signal.SIGINT)
    try:
        process.wait(end_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def wait_for_rows(table: Path, wanted: int, stalled_s: float) -> int:
    """Wait for rows of a growing table, at most `stalled_s` for each; return their number."""
    rows, changed_s = 0, time.monotonic()
    while rows < wanted and time.monotonic() - changed_s < stalled_s:
        now = len(read_results(table)) if table.exists() else 0
        if now > rows:
            rows, changed_s = now, time.monotonic()
        time.sleep(_POLL_S)
    return rows
