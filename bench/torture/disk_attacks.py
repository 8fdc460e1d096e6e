# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kills, disk errors, full disks and power cuts, while a file is made, grows or is saved."""

from collections.abc import Callable, Iterator
from contextlib import redirect_stdout, suppress
from copy import deepcopy
from dataclasses import dataclass
from functools import lru_cache
from io import StringIO
import os
from pathlib import Path
import random
import shutil
import tempfile
import traceback

from convseq_ros.cli import main
from convseq_ros.core.map import autosave
from convseq_ros.core.map.autosave import Autosave
from convseq_ros.core.map.edit import joined, slices_of, unlink, without, write_new
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.writer import save_map
from convseq_ros.core.result_row import COLUMNS, row
from convseq_ros.core.types import Match, Reason, RelativePose
from convseq_ros.errors import MapError
from convseq_ros.io.results import read_results, ResultWriter

from bench.torture import disk
from bench.torture.attack import Attack, Try
from bench.torture.disk import Acknowledged, arm, calls, Disk, How
from bench.torture.maps import APART, drawn, ENCODING, grow, holds

_MOST_PLACES = 40  # in a commit: some pages of every table
_CUTS = 20  # of the power, with one record
_DIED, _REFUSED, _BROKE = 137, 1, 3  # exit codes
_NEVER_S = 1e6

Commits = tuple[int, ...]  # counts of places in each


@dataclass(frozen=True, slots=True)
class Scenario:
    """Something that changes files."""

    prepare: Callable[[Path, Commits], None]  # creates the initial files
    # The work; it acknowledges the number that must exist from then on, or 1 when it is done.
    act: Callable[[Path, Commits, Acknowledged], None]
    # The check; AssertionError if the files do not fit the acknowledged number.
    check: Callable[['Scenario', Path, Commits, int], None]
    is_synced: bool = True  # whether what is acknowledged survives a cut of the power


def _nothing(_path: Path, _commits: Commits) -> None: ...


def _some(path: Path, commits: Commits) -> None:
    save_map(drawn(commits[0]), path)


def _some_more(path: Path, commits: Commits) -> None:
    save_map(drawn(commits[0] + 1), path)


def _crashed(path: Path, commits: Commits) -> None:
    """Create a map after a crash in the middle of a commit, with its committed places."""
    _some(path, commits)
    if not os.fork():
        owner = Autosave(path, ENCODING, APART)
        grow(owner.reference_map, commits[1])
        arm(8, How.TEAR)
        owner.flush()
        os._exit(_BROKE)
    assert os.waitstatus_to_exitcode(os.wait()[1]) == _DIED


def _unlinked(path: Path, commits: Commits) -> None:
    _some(path, commits)
    unlink(path)


def _rows(path: Path, commits: Commits) -> None:
    """Create the table of a crashed run."""
    table = ResultWriter(path, COLUMNS)
    _write(table, commits[0])
    table.abandon()


def _older(path: Path, commits: Commits) -> None:
    """Create the table of a completed run."""
    with ResultWriter(path, COLUMNS) as table:
        _write(table, commits[0])


def _write(table: ResultWriter, count: int, acknowledged: Acknowledged | None = None) -> None:
    for index in range(count):
        table.write(row(Match(index, index, Reason.RECENT), 1.0))
        if acknowledged:
            acknowledged.value = index + 1


def _grow(path: Path, commits: Commits, acknowledged: Acknowledged) -> None:
    owner = Autosave(path, ENCODING, APART)
    acknowledged.value = owner.committed
    try:
        for count in commits:
            grow(owner.reference_map, count)
            try:
                owner.flush()
            except MapError:
                arm(0, How.COUNT)  # the disk has space again
                owner.flush()
            acknowledged.value = owner.committed
    finally:
        owner.close()
    assert owner.committed == len(owner.reference_map)


def _save(path: Path, commits: Commits, acknowledged: Acknowledged) -> None:
    save_map(drawn(sum(commits), 1), path)
    acknowledged.value = 1


def _unlink(path: Path, commits: Commits, acknowledged: Acknowledged) -> None:
    unlink(path, range(commits[0]))
    acknowledged.value = 1


def _link(path: Path, _commits: Commits, _acknowledged: Acknowledged) -> None:
    with redirect_stdout(StringIO()):
        if main(['map', 'link', str(path)]):
            raise MapError('refused')


def _remove(path: Path, commits: Commits, acknowledged: Acknowledged) -> None:
    slices = slices_of(path)
    left = joined(without(slices, {commits[0]}))
    write_new(left, path, instead=slices[0].reference_map)
    acknowledged.value = 1


def _tabulate(path: Path, commits: Commits, acknowledged: Acknowledged) -> None:
    with ResultWriter(path, COLUMNS) as table:
        _write(table, sum(commits), acknowledged)


def _complete(path: Path, commits: Commits, acknowledged: Acknowledged) -> None:
    with ResultWriter(path, COLUMNS) as table:
        _write(table, sum(commits))
    acknowledged.value = 1


def _goes_on(_scenario: Scenario, path: Path, _commits: Commits, acknowledged: int) -> None:
    """Check that the map has all places, and that another program can extend or create it."""
    if acknowledged >= 0:
        assert holds(path) >= acknowledged
    else:
        with suppress(MapError):
            acknowledged = holds(path)
    owner = Autosave(path, ENCODING, APART)
    before = len(owner.reference_map)
    assert before >= acknowledged, f'{before} of {acknowledged}'
    grow(owner.reference_map, 2)
    owner.close()
    assert holds(path) == before + 2
    _nothing_beside(path)


def _old_or_new(scenario: Scenario, path: Path, commits: Commits, acknowledged: int) -> None:
    """Check that a file is the old or the new one, new if acknowledged; the act then makes it."""
    old, new = _undisturbed(scenario, path.name, commits)
    found = _content(path)
    assert found == new or (found == old and acknowledged < 0), 'neither the old nor the new one'
    if found == old:
        if scenario.act is _save:
            _goes_on(scenario, path, commits, commits[0])
        scenario.act(path, commits, Acknowledged())
    assert _content(path) == new
    if scenario.act is not _complete:  # the table of a run that failed stays, under another name
        unlink(path)  # the next program tidies up
        _nothing_beside(path)


@lru_cache
def _undisturbed(scenario: Scenario, name: str, commits: Commits) -> tuple[object, object]:
    """Return the content before and after the act, if nothing fails."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, name)
        scenario.prepare(path, commits)
        old = _content(path)
        scenario.act(path, commits, Acknowledged())
        return old, _content(path)


def _content(path: Path) -> object:
    """Return what a file holds: rows, or places and links."""
    if path.read_bytes()[:6] != b'SQLite':
        return [row['query_index'] for row in read_results(path)]
    opened = open_map(path, ENCODING)
    assert not opened.problem, opened.problem
    pictures = opened.pictures(range(len(opened)))
    shown = [(one.packed.tobytes(), one.thumbnail) for one in pictures]
    links = [
        (one.place, one.other, one.anchor, one.confidence, one.inliers, _moved(one.relative))
        for one in opened.links.each()
    ]
    return [*opened.places], shown, links, opened.links.looked_up_count


def _moved(relative: RelativePose | None) -> object:
    return relative and (relative.position_m, relative.orientation, relative.covariance.tolist())


def _links_again(scenario: Scenario, path: Path, commits: Commits, _acknowledged: int) -> None:
    """Check that all places are there, and that the command goes on and leaves one file."""
    assert len(open_map(path)) == commits[0]
    scenario.act(path, commits, Acknowledged())
    assert open_map(path).is_linked and holds(path) == commits[0]
    _nothing_beside(path)


def _nothing_beside(path: Path) -> None:
    """Check that neither the last program nor an earlier one left temporary files."""
    beside = {one.name for one in path.parent.iterdir()} - {path.name}
    assert not beside, beside


def _tabulated(_scenario: Scenario, path: Path, commits: Commits, acknowledged: int) -> None:
    """Check that the rows of each run are in a file."""
    counts = []
    for file in path.parent.iterdir():
        rows = read_results(file)
        whole = [row for row in rows if row['relative_yaw_rad'] is not None]
        assert [row['query_index'] for row in whole] == [str(each) for each in range(len(whole))]
        counts.append(len(whole))
    assert commits[0] in counts or max(counts) > commits[0], counts
    assert max(counts) >= acknowledged, counts
    assert sum(counts) >= commits[0] + max(0, acknowledged), counts


SCENARIOS = {
    'make': Scenario(_nothing, _grow, _goes_on),
    'grow': Scenario(_some, _grow, _goes_on),
    'grow after a crash': Scenario(_crashed, _grow, _goes_on),
    'save': Scenario(_some, _save, _old_or_new),
    'save over a crash': Scenario(_crashed, _save, _old_or_new),
    'unlink': Scenario(_some, _unlink, _old_or_new),
    'link': Scenario(_unlinked, _link, _links_again),
    'remove': Scenario(_some_more, _remove, _old_or_new),
    'result table': Scenario(_rows, _tabulate, _tabulated, is_synced=False),
    'complete result table': Scenario(_older, _complete, _old_or_new),
}


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
        wanted = (_DIED,) if how in (How.KILL, How.TEAR) and not is_over else (0, _REFUSED)
        if code not in wanted:
            return f'ended with {code}', made.value
        return _checked(scenario, path, commits, acknowledged.value), made.value


def _end(act: Callable[[], None], made: Acknowledged, how: How, call: int) -> None:
    """Do the work, and end this process."""
    code = _BROKE
    try:
        arm(call, how)
        act()
        made.value, code = calls(), 0
    except (MapError, OSError) as error:
        code = _REFUSED if '\n' not in str(error) else _BROKE
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
