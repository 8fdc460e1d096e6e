# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kills a node with a growing map: at its start, and while frames come, also on a slow disk."""

from collections.abc import Iterator
from pathlib import Path
import random
import signal
import time
from typing import Any

from convseq_ros.core.map.reader import open_map

from bench import recordings
from bench.robot import greet, image, Robot, robot
from bench.torture import disk
from bench.torture.attack import Try

_ENDS = signal.SIGINT, signal.SIGTERM
_HOMES = 'HOME', 'ROS_HOME', 'ROS_LOG_DIR'
_TOLD = '[INFO]', 'warning: HOME is not set'
_EARLIEST_S, _LATEST_S, _AT_START_S, _AGAIN_S = 0.3, 3.0, 1.5, 0.3
_MOST_FRAMES, _PERIOD_S, _ANSWER_S = 40, 0.1, 1.0
_WITH_FRAMES_S, _SLOW_S = 3.0, 15.0


def map_kills(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Start and kill a node repeatedly, mostly before it is ready."""
    draw, held = random.Random(seed), 0
    for number in range(count):
        if draw.random() < 0.7:
            name, problem = _at_start(folder, draw)
        else:
            name, problem, held = _with_frames(folder, held, number, draw)
        yield Try(f'{number}: {name}', problem)


def _at_start(folder: Path, draw: random.Random) -> tuple[str, str]:
    """Kill a node that starts, once or twice; return what was done, and the problem."""
    which, after_s = draw.choice(_ENDS), draw.uniform(_EARLIEST_S, _LATEST_S)
    again_s = draw.choice((None, draw.uniform(0.0, _AGAIN_S)))
    is_online, is_homeless = draw.random() < 0.5, draw.random() < 0.2
    online: dict[str, Any] = {'mode': 'online', 'map_path': folder / 'start.db'}
    homeless = {**dict.fromkeys(_HOMES, ''), 'TMPDIR': str(folder)} if is_homeless else {}
    log = folder / 'vpr_node.log'
    log.unlink(missing_ok=True)
    with robot(folder, homeless, waits=False, **(online if is_online else {})) as one:
        time.sleep(after_s)
        one.process.send_signal(which)
        if again_s is not None:
            time.sleep(again_s)
            one.process.send_signal(which)
        problem = _ended(one, _AT_START_S)
    said = log.read_text(encoding='utf-8', errors='replace').splitlines()
    bad = [line for line in said if not any(one in line for one in _TOLD)]
    name = f'{which.name} after {after_s:.3f} s, again after {again_s}, without HOME {is_homeless}'
    return name, ' | '.join([problem, *bad])[:400] if problem or bad else ''


def _with_frames(
    folder: Path, held: int, number: int, draw: random.Random
) -> tuple[str, str, int]:
    """Kill a node while frames come; return also how many places its map holds then."""
    which, frames = draw.choice((*_ENDS, signal.SIGKILL)), draw.randrange(_MOST_FRAMES)
    most_ms, period_s = draw.choice((0, 0, 100, 300, 1000)), draw.choice((0.0, 0.02, _PERIOD_S))
    name = f'{which.name} after {frames} frames, one in {period_s} s, syncs of {most_ms} ms'
    slow = {'LD_PRELOAD': disk.environment(folder)['LD_PRELOAD'], 'DISK_SLOW_MS': str(most_ms)}
    path = folder / 'map.db'
    with robot(
        folder, slow if most_ms else {}, mode='online', map_path=path, image_size_px=256,
        result_file=folder / 'result.csv', diagnostics_period_s=0.2, keyframe_overlap=1.0,
    ) as one:  # fmt: skip
        greet(one)
        wanted = one.answers + frames
        for index in range(frames):
            stamp_ns = 10**18 + number * 10**11 + index * 10**8
            one.camera.publish(image(recordings.gray(number * _MOST_FRAMES + index), stamp_ns))
            one.spin(period_s)
        if period_s == _PERIOD_S and not one.wait_for(lambda: one.answers >= wanted, _ANSWER_S):
            return name, f'{wanted - one.answers} frames are not answered', held
        is_killed = which is signal.SIGKILL
        promised = max(held, one.count('places_kept' if is_killed else 'map_size'))
        one.process.send_signal(which)
        most_s = _SLOW_S if most_ms else _WITH_FRAMES_S
        problem = _ended(one, most_s, -signal.SIGKILL if is_killed else 0)
    places = len(open_map(path))
    problem = problem or (f'{places} places of {promised}' if places < promised else '')
    return name, problem, places


def _ended(one: Robot, most_s: float, wanted: int = 0) -> str:
    if not one.wait_for(lambda: one.process.poll() is not None, most_s):
        return f'did not end within {most_s:g} s'
    code = one.process.poll()
    return f'exit {code}' if code != wanted else ''
