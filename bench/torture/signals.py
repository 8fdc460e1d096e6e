# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Signals at random moments of a node's life."""

from collections.abc import Iterator
import os
from pathlib import Path
import random
import signal
import subprocess
import sys
import time

from convseq_ros.cli.processes import environment

from bench.torture.attack import Try

ABOUT = 'SIGINT or SIGTERM from .3 to 3 s after the start of `vpr_node`, half of them twice'
ORACLE = 'exit 0 within 1.5 s; on standard error nothing but lines of information'
COUNT, PORTION, SHORT, SEED = 500, 50, 2, 16
_EARLIEST_S, _LATEST_S = 0.3, 3.0
_MOST_S = 1.5
_HANGS_S = 20.0


def run(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Start and end a node, in turn without a map, and with one that grows."""
    draw = random.Random(seed)
    for number in range(count):
        which = draw.choice((signal.SIGINT, signal.SIGTERM))
        after_s = draw.uniform(_EARLIEST_S, _LATEST_S)
        again_s = draw.choice((None, draw.uniform(0.0, 0.3)))
        is_online = draw.random() < 0.5
        name = f'{number}: {which.name} after {after_s:.3f} s' + (
            f', again after {again_s:.3f} s' if again_s is not None else ''
        )
        yield Try(name, _problem(folder, which, after_s, again_s, is_online))


def _problem(
    folder: Path, which: signal.Signals, after_s: float, again_s: float | None, is_online: bool
) -> str:
    command = [sys.executable, '-m', 'convseq_ros.node', '--ros-args']
    if is_online:
        command += ['-p', 'mode:=online', '-p', f'map_path:={folder / "map.db"}']
    process = subprocess.Popen(
        command,
        env=environment(folder) | {'PYTHONPATH': os.pathsep.join(sys.path)},
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    time.sleep(after_s)
    sent_s = time.monotonic()
    process.send_signal(which)
    if again_s is not None:
        time.sleep(again_s)
        process.send_signal(which)
    try:
        told, _ = process.communicate(timeout=_HANGS_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return f'did not end within {_HANGS_S:g} s'
    took_s = time.monotonic() - sent_s
    bad = [line for line in told.splitlines() if '[INFO]' not in line]
    if process.returncode or bad:
        return f'exit {process.returncode}: {" | ".join(bad)[-300:]}'
    return f'took {took_s:.2f} s' if took_s > _MOST_S else ''
