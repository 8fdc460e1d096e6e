# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kills, power cuts, disk errors and full disks, while files change."""

from collections.abc import Iterator
from copy import deepcopy
from dataclasses import replace
from itertools import cycle, islice
import os
from pathlib import Path
import random
import shutil
import tempfile
import traceback
from typing import NoReturn

from convseq_ros.core.map import appender
from convseq_ros.errors import MapError

from bench.torture import disk
from bench.torture.attack import Try
from bench.torture.disk import Call, Disk
from bench.torture.scenarios import Commits, Scenario, SCENARIOS

_REFUSED, _BROKE = 1, 3  # exit codes
_MOST_PLACES = 40  # in a commit: some pages of every table
_MOST_CALLS = 130  # of a scenario, or some more
_CUTS = 10  # with one record
appender._COMMIT_EVERY_S = 1e6  # only on request


def map_writes(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Let a call of a scenario fail, or all from then on that need room, again and again."""
    draw, made = random.Random(seed), 0
    while made < count:
        name, commits = draw.choice([*SCENARIOS]), _commits(draw)
        call, is_full = draw.randint(1, _MOST_CALLS), draw.random() < 0.5
        with tempfile.TemporaryDirectory(dir=folder) as scratch:
            path = Path(scratch, 'map.db')
            SCENARIOS[name].prepare(path, commits)
            code, calls = _recorded(SCENARIOS[name], path, commits, call, is_full)
            if not any(one.what == 'f' for one in calls):
                continue  # there were fewer
            problem = _checked(SCENARIOS[name], path, commits, calls)
        problem = problem if code in (0, _REFUSED) else f'ended with {code}'
        made += 1
        yield Try(f'{name} {commits}, {"full" if is_full else "error"} at {call}', problem)


def map_power(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Record the calls of every scenario, and kill it or cut the power at some of them."""
    return islice(_cuts(random.Random(seed), folder), count)


def _cuts(draw: random.Random, folder: Path) -> Iterator[Try]:
    for name, scenario in cycle(SCENARIOS.items()):
        commits = _commits(draw)
        with tempfile.TemporaryDirectory(dir=folder) as scratch:
            path = Path(scratch, 'map.db')
            scenario.prepare(path, commits)
            start = Disk(path.parent)
            code, calls = _recorded(scenario, path, commits)
            assert code == 0
        for _ in range(_CUTS):
            how, at = draw.choice(('power', 'kill', 'kill within')), draw.randrange(len(calls))
            left = deepcopy(start)
            for call in calls[:at]:
                left.see(call)
            if how == 'kill within' and calls[at].what == 'w':
                left.see(replace(calls[at], data=calls[at].data[: len(calls[at].data) // 2]))
            left.cut(draw) if how == 'power' else left.kill()
            path.parent.mkdir()
            left.restore()
            problem = _checked(scenario, path, commits, calls[:at])
            shutil.rmtree(path.parent)
            yield Try(f'{name} {commits}, {how} at {at} of {len(calls)} calls', problem)


def _commits(draw: random.Random) -> Commits:
    return (*(draw.randint(2, _MOST_PLACES) for _ in range(3)),)


def _recorded(
    scenario: Scenario, path: Path, commits: Commits, fails: int = 0, is_full: bool = False
) -> tuple[int, list[Call]]:
    """Let a scenario act in a fork; return its exit code and its calls."""
    record = path.parent.with_name('record')
    if not os.fork():
        disk.arm(record, fails, is_full)
        _act(scenario, path, commits)
    code = os.waitstatus_to_exitcode(os.wait()[1])
    return code, [*disk.recorded_calls(record)]


def _act(scenario: Scenario, path: Path, commits: Commits) -> NoReturn:
    """Let a scenario act, and end this process."""
    code = _BROKE
    try:
        scenario.act(path, commits)
        code = 0
    except (MapError, OSError) as error:
        code = _REFUSED if '\n' not in str(error) else _BROKE
    except BaseException:
        traceback.print_exc()
    os._exit(code)


def _checked(scenario: Scenario, path: Path, commits: Commits, calls: list[Call]) -> str:
    """Return what does not fit what was acknowledged with the calls."""
    try:
        scenario.check(scenario, path, commits, disk.acknowledged(calls))
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        return f'{error!r} ({where.name}, line {where.lineno})'
    return ''
