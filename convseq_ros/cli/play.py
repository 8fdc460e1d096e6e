# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Publish a recording to live topics: `convseq play RECORDING`, a process of its own."""

from collections.abc import Sequence
import importlib.util
import os
import signal
import sys

from convseq_ros.cli.processes import for_large_images
from convseq_ros.errors import ConvseqError
from convseq_ros.installing import NEEDS_ROS
from convseq_ros.process import SIGNALS


def main(arguments: Sequence[str]) -> int:
    """
    Become the player, which is a ROS node; it reads the arguments.

    Raises
    ------
    ConvseqError
        If ROS is not installed or not sourced.

    """
    if importlib.util.find_spec('rclpy') is None:
        raise ConvseqError(NEEDS_ROS)
    player = [sys.executable, '-m', 'convseq_ros.node.player', *arguments]
    sys.stdout.flush()
    # Until the player stands by, signals wait: a new Python dies of them, and says so at length.
    signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    os.execve(sys.executable, player, {**os.environ, **for_large_images()})
