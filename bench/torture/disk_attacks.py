# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kills, disk errors, full disks and power cuts, while files change."""

from collections.abc import Callable, Iterator
from copy import deepcopy
import os
from pathlib import Path
import random
import shutil
import tempfile
import traceback

from convseq_ros.core.map import autosave
from convseq_ros.errors import MapError

from bench.torture import disk
from bench.torture.attack import Attack, Try
from bench.torture.disk import Acknowledged, arm, calls, Disk, How
from bench.torture.scenarios import BROKE, Commits, DIED, REFUSED, Scenario, SCENARIOS

_MOST_PLACES = 40  # in a commit: some pages of every table
_CUTS = 20  # of the power, with one record
_NEVER_S = 1e6


def _writes(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Fail every call of every scenario in every way, as many of these as are asked for."""
    autosave._COMMIT_EVERY_S = _NEVER_S  # commit only on request
    draw, made = random.Random(seed), 0
    while made < count:
        commits = (*(draw.randint(1, _MOST_PLACES) for _ in range(3)),)
        planned = [
            (name, how, call)
            for name, scenario in SCENARIOS.items()
            for last in [_failing(scenario, commits, How.COUNT, 0, folder)[1]]
            for how in (How.KILL, How.TEAR, How.FULL, How.FAIL)
            for call in range(1, last + 1)
        ]
        draw.shuffle(planned)
        for name, how, call in planned[: count - made]:
            problem, calls_made = _failing(SCENARIOS[name], commits, how, call, folder)
            if problem or calls_made >= call or calls_made < 0:
                made += 1
                yield Try(f'{name} {commits}, {how.name} at call {call}', problem)


def _failing(
    scenario: Scenario, commits: Commits, how: How, call: int, folder: Path
) -> tuple[str, int]:
    """Return the problem and the number of calls; -1 if the process did not end."""
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        path = Path(scratch, 'map.db')
        scenario.prepare(path, commits)
        acknowledged, made = Acknowledged(), Acknowledged()
        if not os.fork():
            _end(lambda: scenario.act(path, commits, acknowledged), made, how, call)
        code = os.waitstatus_to_exitcode(os.wait()[1])
        # Occasionally a checksum is shorter, a page is not needed, and there are fewer calls.
        is_over = 0 <= made.value < call
        wanted = (DIED,) if how in (How.KILL, How.TEAR) and not is_over else (0, REFUSED)
        if code not in wanted:
            return f'ended with {code}', made.value
        return _checked(scenario, path, commits, acknowledged.value), made.value


def _end(act: Callable[[], None], made: Acknowledged, how: How, call: int) -> None:
    """Do the work, and end this process."""
    code = BROKE
    try:
        arm(call, how)
        act()
        made.value, code = calls(), 0
    except (MapError, OSError) as error:
        code = REFUSED if '\n' not in str(error) else BROKE
    except BaseException:
        traceback.print_exc()
    os._exit(code)


def _checked(scenario: Scenario, path: Path, commits: Commits, acknowledged: int) -> str:
    try:
        scenario.check(scenario, path, commits, acknowledged)
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        return f'{error!r} ({where.name}, line {where.lineno})'
    return ''


def _power(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Record the calls of every scenario, and cut the power at some of them."""
    autosave._COMMIT_EVERY_S = _NEVER_S
    draw, made = random.Random(seed), 0
    while made < count:
        commits = (*(draw.randint(1, _MOST_PLACES) for _ in range(3)),)
        for name, scenario in SCENARIOS.items():
            if not scenario.is_synced:
                continue
            with tempfile.TemporaryDirectory(dir=folder) as scratch:
                path, acknowledged = Path(scratch, 'map.db'), Acknowledged()
                scenario.prepare(path, commits)
                start, record = Disk.of(path.parent), folder / 'record'
                if not (child := os.fork()):
                    with disk.recorded(record, acknowledged):
                        scenario.act(path, commits, acknowledged)
                    os._exit(0)
                assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
                made_calls = [*disk.recorded_calls(record)]
            for _ in range(min(_CUTS, count - made)):
                made += 1
                cut, left = draw.randint(0, len(made_calls)), deepcopy(start)
                last = made_calls[cut].acknowledged if cut < len(made_calls) else None
                for call in made_calls[:cut]:
                    left.see(call)
                left.cut(draw)
                path.parent.mkdir()
                left.restore()
                known = acknowledged.value if last is None else last
                problem = _checked(scenario, path, commits, known)
                shutil.rmtree(path.parent)
                yield Try(f'{name} {commits}, cut after {cut} of {len(made_calls)} calls', problem)


ATTACKS = {
    'map_writes': Attack(
        'A map with links is made, grows, grows after a crash, is saved over another or over what'
        ' a crash left, loses its links, gets them, or loses a place; a result table is written: '
        'the process ends before or within the n-th call that changes the disk, or that call '
        'fails, or the disk is full from then on',
        'what was acknowledged is there, all that is there is right, nothing is half there; the '
        'next program goes on with it; errors are one line',
        2_000, 100, 12, _writes, disk.environment,
    ),
    'map_power': Attack(
        'The power is cut at a random call of those of `map_writes`: of what was written since a '
        'file was synced last, each 512 bytes are there or not; of the names since their folder '
        'was, the first so many',
        'that of `map_writes`',
        2_000, 200, 16, _power, disk.environment,
    ),
}  # fmt: skip
