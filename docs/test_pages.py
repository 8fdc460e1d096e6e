# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Run every command of the documentation in a fresh clone: `make docs-test`.

Each ```bash block of a page runs in the clone's folder, in order, and must succeed. A comment on
the line before says otherwise: <!-- terminal --> starts it in a terminal of its own, and
<!-- Ctrl-C --> ends those; <!-- not run here: why --> is only checked by `bash -n`.
`ros2 bag play`, which PyPI has not, is what plays the demo.
"""

from collections.abc import Callable, Iterator
import contextlib
import csv
import os
from pathlib import Path
import re
import signal
import subprocess
import time
from typing import NamedTuple

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]
PAGES = REPOSITORY / 'docs'
BLOCK = re.compile(r'(?:<!-- ([^\n]*?) -->\n)?```bash\n(.*?)```|<!-- (Ctrl-C) -->', re.DOTALL)
NOT_RUN = 'not run here: '
LISTENS_S, ENDS_S = 60, 20
PLAY = """#!/bin/sh
# ros2 bag play FOLDER --rate RATE
names='/odom:=/odom /camera/camera_info:=/camera/camera_info /camera/image_raw:=/camera/image_raw'
exec python -m convseq_ros.node.outputs.drive_sender "$3" "$5" $names
"""
FIRST = 'tutorials/first_map.md'  # makes what the other pages use


class Block(NamedTuple):
    """Some lines of bash, and what the page says of them: '', terminal, Ctrl-C or not run ..."""

    lines: str
    how: str


class Task(NamedTuple):
    """What somebody wants who is here for the first time."""

    page: str
    minutes: float
    is_done: Callable[[Path], bool]


def rows(path: Path) -> list[dict[str, str]]:
    """Return the rows of a result table."""
    with path.open(newline='', encoding='utf-8') as file:
        return list(csv.DictReader(file))


def accepted(path: Path) -> int:
    """Return how many frames of a table were accepted."""
    return sum(row['status'] == 'accepted' for row in rows(path))


TASKS = {
    'map and recognise two recordings, and live with a bag': Task(
        FIRST,
        3,
        lambda clone: accepted(clone / 'result.csv') > 100 and accepted(clone / 'live.csv') > 50,
    ),
    'find out why a frame was refused': Task(
        'howto/why_refused.md', 1, lambda clone: (clone / 'result.csv').is_file()
    ),
    'a robot that maps as it goes': Task(
        'tutorials/maps_as_it_goes.md', 3, lambda clone: accepted(clone / 'again.csv') > 50
    ),
    'many recordings, many maps': Task(
        'tutorials/fleet.md',
        3,
        lambda clone: int((clone / 'fleet.txt').read_text().split()[0]) > 50,
    ),
    'a trajectory from one recording': Task(
        'tutorials/pose_graph.md', 3, lambda clone: (clone / 'before_after.svg').is_file()
    ),
    'an own set against an own descriptor': Task(
        'tutorials/own_network.md',
        5,
        lambda clone: (clone / 'my_results' / 'report.html').is_file(),
    ),
    'closures into GTSAM': Task(
        'tutorials/connect_a_back_end.md',
        4,
        lambda clone: 'EDGE' in (clone / 'graph.g2o').read_text(),
    ),
}
OTHERS = sorted(
    page.relative_to(PAGES).as_posix()
    for page in PAGES.rglob('*.md')
    if page.relative_to(PAGES).as_posix() not in {task.page for task in TASKS.values()}
    and '```bash' in page.read_text(encoding='utf-8')
)


def blocks(page: str) -> list[Block]:
    """Return the commands of a page."""
    text = (PAGES / page).read_text(encoding='utf-8')
    return [Block(lines, how or end) for how, lines, end in BLOCK.findall(text)]


@pytest.fixture(scope='session')
def clone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a clone of what is committed, as a stranger has it."""
    path = tmp_path_factory.mktemp('stranger') / 'convseq_ros'
    subprocess.run(['git', 'clone', '-q', REPOSITORY, path], check=True)
    player = path.parent / 'bin' / 'ros2'
    player.parent.mkdir()
    player.write_text(PLAY)
    player.chmod(0o755)
    return path


def environment(clone: Path) -> dict[str, str]:
    """Return that of a stranger's terminal, whose nodes nobody else hears."""
    own = {
        'HOME': str(clone.parent),
        'ROS_DOMAIN_ID': '97',
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        'ROS_LOG_DIR': str(clone.parent / 'log'),
        'PATH': f'{clone.parent}/bin:{os.environ["PATH"]}',
    }
    return own | {name: value for name, value in os.environ.items() if name.startswith('PIP_')}


def started(clone: Path, block: Block, log: Path) -> subprocess.Popen[bytes]:
    """Start a block as in a terminal of its own."""
    activate = '[ ! -f .venv/bin/activate ] || source .venv/bin/activate; set -e\n'
    with log.open('ab') as told:
        return subprocess.Popen(
            ['bash', '-c', activate + block.lines],
            cwd=clone,
            env=environment(clone),
            stdin=subprocess.DEVNULL,
            stdout=told,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )


class Terminals:
    """Those in which something runs until Ctrl-C."""

    def __init__(self, clone: Path) -> None:
        self._clone, self._running = clone, list[tuple[subprocess.Popen[bytes], Path]]()

    def open(self, block: Block) -> None:
        """Start something, and wait until a node says that it listens."""
        log = self._clone.parent / f'terminal{time.monotonic_ns()}.log'
        process = started(self._clone, block, log)
        self._running.append((process, log))
        deadline_s = time.monotonic() + LISTENS_S
        while 'vpr_node' in block.lines and 'listening' not in log.read_text():
            assert process.poll() is None and time.monotonic() < deadline_s, log.read_text()
            time.sleep(0.1)

    def interrupt(self) -> None:
        """Press Ctrl-C in all of them."""
        for process, log in self._running:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGINT)
            process.wait(ENDS_S)
            assert 'Traceback' not in log.read_text(), log.read_text()
        self._running.clear()


@pytest.fixture
def terminals(clone: Path) -> Iterator[Terminals]:
    """Return where things run beside each other; all end with the page."""
    beside = Terminals(clone)
    yield beside
    beside.interrupt()


def follow(clone: Path, page: str, terminals: Terminals) -> None:
    """Do what a page says."""
    for block in blocks(page):
        if block.how == 'Ctrl-C':
            terminals.interrupt()
        elif block.how == 'terminal':
            terminals.open(block)
        elif block.how.startswith(NOT_RUN):
            subprocess.run(['bash', '-n'], input=block.lines, text=True, check=True)
        else:
            log = clone.parent / 'block.log'
            log.write_text('')
            code = started(clone, block, log).wait()
            assert code == 0, f'{page}: {block.lines}\n{log.read_text()}'
    terminals.interrupt()


@pytest.mark.parametrize('name', TASKS)
def test_a_first_time_user_is_done_in_time(
    name: str, clone: Path, terminals: Terminals, record_property: Callable[[str, object], None]
) -> None:
    task = TASKS[name]
    if task.page != FIRST and not (clone / 'street.db').exists():  # this page alone was asked for
        follow(clone, FIRST, terminals)
    started_s = time.monotonic()
    follow(clone, task.page, terminals)
    took_s = time.monotonic() - started_s
    print(f'\n{name}: {took_s:.0f} s of {task.minutes * 60:.0f} s')
    record_property('seconds', round(took_s))
    assert task.is_done(clone)
    if 'CONVSEQ_NO_HURRY' not in os.environ:  # for a machine that others use, too
        assert took_s < task.minutes * 60


@pytest.mark.parametrize('page', OTHERS)
def test_the_commands_of_a_page_run(page: str, clone: Path, terminals: Terminals) -> None:
    follow(clone, page, terminals)
