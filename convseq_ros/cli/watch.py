# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""See in a terminal what a node recognises: `convseq watch MAP`, a process of its own."""

from collections.abc import Sequence
from importlib.util import find_spec
import os
import signal
import sys

from convseq_ros.errors import ConvseqError
from convseq_ros.installing import NEEDS_ROS, pip_install
from convseq_ros.process import SIGNALS


def main(arguments: Sequence[str]) -> int:
    """
    Become the watcher, which is a ROS node; it reads the arguments.

    Raises
    ------
    ConvseqError
        If ROS or rich is not installed.

    """
    if find_spec('rclpy') is None:
        raise ConvseqError(NEEDS_ROS)
    if find_spec('rich') is None:
        raise ConvseqError(f'watching needs rich: {pip_install("rich")}')
    sys.stdout.flush()
    signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    os.execv(sys.executable, [sys.executable, '-m', 'convseq_ros.node.watch', *arguments])
