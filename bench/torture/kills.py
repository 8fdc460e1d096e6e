# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kills a node with a growing map: at its start, between frames, on a slow disk."""

from collections.abc import Iterator
import os
from pathlib import Path
import random
import signal
import subprocess
import sys
import time

from convseq_ros.cli.processes import environment
from convseq_ros.core.map.reader import open_map

from bench.robot import greet, image, Robot, robot
from bench.torture import corpus, disk
from bench.torture.attack import Attack, Try

_ENDS = signal.SIGINT, signal.SIGTERM
_HOMES = 'HOME', 'ROS_HOME', 'ROS_LOG_DIR'
_EARLIEST_S, _LATEST_S, _AT_START_S, _HANGS_S = 0.3, 3.0, 1.5, 20.0
_WITH_FRAMES_S, _SLOW_S = 3.0, 15.0
_SLOW_FRAMES, _PERIOD_S, _ANSWER_S, _TOLD_S = 40, 0.1, 1.0, 0.6


def _run(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Start and kill a node repeatedly, mostly before it is ready."""
    draw, held, path = random.Random(seed), 0, folder / 'map.db'
    for number in range(count):
        when = draw.choices(('start', 'frames', 'slow disk'), (7, 2, 1))[0]
        if when == 'start':
            name, problem = _at_start(folder, draw)
        elif when == 'frames':
            name, problem, held = _with_frames(folder, path, held, number, draw)
        else:
            name, problem = _on_slow_disk(folder, number, draw)
        yield Try(f'{number} ({when}): {name}', problem)


def _at_start(folder: Path, draw: random.Random) -> tuple[str, str]:
    which, after_s = draw.choice(_ENDS), draw.uniform(_EARLIEST_S, _LATEST_S)
    again_s = draw.choice((None, draw.uniform(0.0, 0.3)))
    name = f'{which.name} after {after_s:.3f} s' + (f', again after {again_s}' if again_s else '')
    command = [sys.executable, '-m', 'convseq_ros.node', '--ros-args']
    if draw.random() < 0.5:
        command += ['-p', 'mode:=online', '-p', f'map_path:={folder / "start.db"}']
    variables = environment(folder) | {'PYTHONPATH': os.pathsep.join(sys.path)}
    if draw.random() < 0.2:
        name += ', without HOME'
        variables = {key: variables[key] for key in variables if key not in _HOMES}
        variables['TMPDIR'] = str(folder)  # where logs go then
    process = subprocess.Popen(
        command,
        env=variables,
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
        output, _ = process.communicate(timeout=_HANGS_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return name, f'did not end within {_HANGS_S:g} s'
    took_s = time.monotonic() - sent_s
    told = '[INFO]', 'warning: HOME is not set'
    bad = [line for line in output.splitlines() if not any(one in line for one in told)]
    if process.returncode or bad:
        return name, f'exit {process.returncode}: {" | ".join(bad)[-300:]}'
    return name, f'took {took_s:.2f} s' if took_s > _AT_START_S else ''


def _with_frames(
    folder: Path, path: Path, held: int, number: int, draw: random.Random
) -> tuple[str, str, int]:
    which, frames = draw.choice(_ENDS), draw.randrange(40)
    stamp_ns = 10**18 + number * 10**11
    chosen = {'map_path': path, 'result_file': folder / 'result.csv'}
    with robot(folder, mode='online', keyframe_overlap=1.0, image_size_px=256, **chosen) as one:
        for index in range(frames):
            stamp_ns += 10**8
            one.camera.publish(image(corpus.gray(number * 40 + index), stamp_ns))
            one.spin(draw.choice((0.0, 0.02)))
        one.process.send_signal(which)
        problem = _ended(one, _WITH_FRAMES_S)
    places = len(open_map(path))
    if places < held:
        problem = f'{places} places, {held} before'
    return f'{which.name} after {frames} frames', problem, places


def _on_slow_disk(folder: Path, number: int, draw: random.Random) -> tuple[str, str]:
    which, most_ms = draw.choice((signal.SIGTERM, signal.SIGKILL)), draw.choice((100, 300, 1000))
    name, path = f'{which.name}, syncs of {most_ms} ms', folder / f'{number}.db'
    slow = {'LD_PRELOAD': disk.environment(folder)['LD_PRELOAD'], 'DISK_SLOW_MS': str(most_ms)}
    chosen = {'mode': 'online', 'map_path': path, 'diagnostics_period_s': 0.2}
    with robot(folder, slow, keyframe_overlap=1.0, image_size_px=256, **chosen) as one:
        greet(one)
        wanted = one.answers + _SLOW_FRAMES
        for index in range(_SLOW_FRAMES):
            stamp_ns = 10**18 + round(index * _PERIOD_S * 1e9)
            one.camera.publish(image(corpus.gray(number * _SLOW_FRAMES + index), stamp_ns))
            one.spin(_PERIOD_S)
        if not one.wait_for(lambda: one.answers >= wanted, _ANSWER_S):
            return name, f'{wanted - one.answers} frames are not answered'
        one.spin(_TOLD_S)
        is_killed = which is signal.SIGKILL
        promised = one.count('places_kept' if is_killed else 'map_size')
        one.process.send_signal(which)
        if problem := _ended(one, _SLOW_S, -signal.SIGKILL if is_killed else 0):
            return name, problem
    places = len(open_map(path))
    return name, f'{places} places, {promised} were promised' if places < promised else ''


def _ended(one: Robot, most_s: float, wanted: int = 0) -> str:
    if not one.wait_for(lambda: one.process.poll() is not None, most_s):
        return f'did not end within {most_s:g} s'
    code = one.process.poll()
    return f'exit {code}' if code != wanted else ''


ATTACKS = {
    'map_kills': Attack(
        'SIGINT or SIGTERM from .3 to 3 s after the start of `vpr_node`, half of them twice, a '
        'fifth without HOME; or while frames come, before a start on the same growing map; or '
        'SIGTERM or SIGKILL while every sync of the disk takes up to 1 s longer, as on a worn '
        'card',
        'exit 0 within 1.5 s of the start, 3 s with frames, 15 s on the slow disk; nothing but '
        'lines of information, and one of HOME; the map opens, and holds what it held before and '
        'what was called kept; on the slow disk frames are answered within a second',
        600, 50, 0, _run,
    )
}  # fmt: skip
