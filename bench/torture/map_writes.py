# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Every single call that changes the disk, while a map is made, grows or is saved."""

from collections.abc import Iterator
from pathlib import Path

from bench.torture.attack import Try
from bench.torture.disk import tries_of

ABOUT = (
    'A map with links is made, grows, grows after a crash, is saved over another or over what a '
    'crash left, loses its links, or a place; a result table is written: the process ends before '
    'or within the n-th call that changes the disk, or that call fails, or the disk is full from '
    'then on'
)
ORACLE = (
    'what was acknowledged is there, all that is there is right, nothing is half there; the '
    'next program goes on with it; errors are one line'
)
COUNT, PORTION, SHORT, SEED = 2_000, 100, 12, 16


def run(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Have a program that has the failing disk make the tries, each in a fork."""
    yield from tries_of('scenarios', count, seed, folder)
