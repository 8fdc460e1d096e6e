# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""See in a terminal what a node recognises: `convseq watch MAP`, a process of its own."""

from collections.abc import Sequence
from importlib.util import find_spec
from typing import NoReturn

from convseq_ros.cli.processes import become
from convseq_ros.errors import ConvseqError
from convseq_ros.installing import pip_install


def main(arguments: Sequence[str]) -> NoReturn:
    """
    Become the watcher, which is a ROS node; it reads the arguments.

    Raises
    ------
    ConvseqError
        If ROS or rich is not installed.

    """
    if find_spec('rich') is None:
        raise ConvseqError(f'watching needs rich: {pip_install("rich")}')
    become('convseq_ros.node.watch', arguments)
