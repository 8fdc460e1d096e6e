# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Publish a recording to live topics: `convseq play RECORDING`, a process of its own."""

from collections.abc import Sequence
from typing import NoReturn

from convseq_ros.cli.processes import become
from convseq_ros.middleware import fast_dds, LARGE_IMAGES


def main(arguments: Sequence[str]) -> NoReturn:
    """
    Become the player, which is a ROS node; it reads the arguments.

    Raises
    ------
    ConvseqError
        If ROS is not installed or not sourced.

    """
    become('convseq_ros.node.player', arguments, **fast_dds(LARGE_IMAGES))
