# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Fails every call that changes the disk, while a map is built, grows or is saved.

`run` starts `python -m bench.torture.map_writes COUNT SEED FOLDER` on the failing disk. This
program makes each try in a fork, and prints a line of JSON per try.
"""

from collections.abc import Callable, Iterator
from contextlib import redirect_stdout, suppress
from dataclasses import dataclass
from io import StringIO
import os
from pathlib import Path
import random
import tempfile
import traceback

from convseq_ros.cli import main
from convseq_ros.core.map.autosave import Autosave
from convseq_ros.core.map.edit import joined, slices_of, unlink, without, write_new
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.writer import save_map
from convseq_ros.core.result_row import COLUMNS, row
from convseq_ros.core.types import Match, Reason
from convseq_ros.errors import MapError
from convseq_ros.io.results import read_results, ResultWriter

from bench.torture.attack import Try
from bench.torture.disk import Acknowledged, arm, calls, How, print_tries, tries_of
from bench.torture.maps import APART, drawn, ENCODING, grow, holds

ABOUT = (
    'A map with links is made, grows, grows after a crash, is saved over another or over what a '
    'crash left, loses its links, gets them, or loses a place; a result table is written: the '
    'process ends before or within the n-th call that changes the disk, or that call fails, or '
    'the disk is full from then on'
)
ORACLE = (
    'what was acknowledged is there, all that is there is right, nothing is half there; the '
    'next program goes on with it; errors are one line'
)
COUNT, PORTION, SHORT, SEED = 2_000, 100, 12, 16
_MOST_PLACES = 40  # in a commit: some pages of every table
_DIED, _REFUSED, _BROKE = 137, 1, 3  # exit codes


def run(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Run a program on the failing disk that makes the tries, each in a fork."""
    yield from tries_of('map_writes', count, seed, folder)


@dataclass(frozen=True, slots=True)
class Scenario:
    """A scenario; its functions take the map's path and the number of places per commit."""

    prepare: Callable[[Path, list[int]], None]  # creates the initial files
    # The work; it acknowledges the number of places that must exist from then on.
    act: Callable[[Path, list[int], Acknowledged], None]
    # The check; AssertionError if the files do not fit the acknowledged number.
    check: Callable[[Path, list[int], int], None]


def _some(path: Path, commits: list[int]) -> None:
    save_map(drawn(commits[0]), path)


def _some_more(path: Path, commits: list[int]) -> None:
    save_map(drawn(commits[0] + 1), path)


def _crashed(path: Path, commits: list[int]) -> None:
    """Create a map after a crash in the middle of a commit, with its committed places."""
    _some(path, commits)
    if not os.fork():
        owner = Autosave(path, ENCODING, APART)
        grow(owner.reference_map, commits[1])
        arm(8, How.TEAR)
        owner.flush()
        os._exit(_BROKE)
    assert os.waitstatus_to_exitcode(os.wait()[1]) == _DIED


def _own(path: Path, commits: list[int], acknowledged: Acknowledged) -> None:
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


def _goes_on(path: Path, _commits: list[int], acknowledged: int) -> None:
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


def _nothing_beside(path: Path) -> None:
    """Check that neither the last program nor an earlier one left temporary files."""
    beside = {one.name for one in path.parent.iterdir()} - {'old.db', path.name}
    assert not beside, beside


def _save(path: Path, commits: list[int], acknowledged: Acknowledged) -> None:
    save_map(drawn(sum(commits), 1), path)
    acknowledged.value = 1


def _old_or_new(path: Path, commits: list[int], acknowledged: int) -> None:
    """Check that the map is the old or the new one, and the new one if acknowledged."""
    if open_map(path).places[0].source == 'drive 1':
        assert holds(path, 1) == sum(commits)
    else:
        assert acknowledged < 0 and holds(path) == commits[0]
        _goes_on(path, commits, commits[0])
    save_map(drawn(3, 2), path)
    assert holds(path, 2) == 3
    _nothing_beside(path)


def _unlink(path: Path, commits: list[int], acknowledged: Acknowledged) -> None:
    unlink(path, range(commits[0]))
    acknowledged.value = 1


def _linked_or_not(path: Path, commits: list[int], acknowledged: int) -> None:
    """Check that the map has all links or none, and none if acknowledged."""
    assert holds(path) == commits[0]
    if len(open_map(path).links):
        assert acknowledged < 0 and len(open_map(path).links) == len(drawn(commits[0]).links)
    unlink(path)
    assert not open_map(path).links.looked_up_count
    _nothing_beside(path)


def _unlinked(path: Path, commits: list[int]) -> None:
    _some(path, commits)
    unlink(path)


def _link(path: Path, _commits: list[int], _acknowledged: Acknowledged) -> None:
    with redirect_stdout(StringIO()):
        if main(['map', 'link', str(path)]):
            raise MapError('refused')


def _links_again(path: Path, commits: list[int], _acknowledged: int) -> None:
    """Check that all places are there, and that the same command goes on and leaves one file."""
    assert len(open_map(path)) == commits[0]
    _link(path, commits, Acknowledged())
    assert open_map(path).is_linked and holds(path) == commits[0]
    _nothing_beside(path)


def _thin(path: Path, commits: list[int], acknowledged: Acknowledged) -> None:
    slices = slices_of(path)
    left = joined(without(slices, {commits[0]}))
    write_new(left, path, instead=slices[0].reference_map)
    acknowledged.value = 1


def _thinned_or_not(path: Path, commits: list[int], acknowledged: int) -> None:
    """Check that all other places exist, and that the last one is removed if acknowledged."""
    count = holds(path)
    assert count == commits[0] or (acknowledged < 0 and count == commits[0] + 1)
    unlink(path)
    _nothing_beside(path)


def _rows(path: Path, commits: list[int]) -> None:
    """Create the table of a crashed run."""
    table = ResultWriter(path, COLUMNS)
    _write(table, commits[0])
    table.abandon()


def _write(table: ResultWriter, count: int, acknowledged: Acknowledged | None = None) -> None:
    for index in range(count):
        table.write(row(Match(index, index, Reason.RECENT), 1.0))
        if acknowledged:
            acknowledged.value = index + 1


def _tabulate(path: Path, commits: list[int], acknowledged: Acknowledged) -> None:
    with ResultWriter(path, COLUMNS) as table:
        _write(table, sum(commits), acknowledged)


def _tabulated(path: Path, commits: list[int], acknowledged: int) -> None:
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


def _older(path: Path, commits: list[int]) -> None:
    """Create the table of a completed run."""
    with ResultWriter(path, COLUMNS) as table:
        _write(table, commits[0])


def _complete(path: Path, commits: list[int], acknowledged: Acknowledged) -> None:
    with ResultWriter(path, COLUMNS) as table:
        _write(table, sum(commits))
    acknowledged.value = 1


def _whole(path: Path, commits: list[int], acknowledged: int) -> None:
    """Check that the table is completely that of one of the two runs."""
    rows = len(read_results(path))
    assert rows == sum(commits) or (acknowledged < 0 and rows == commits[0]), rows


SCENARIOS = {
    'make': Scenario(lambda *_: None, _own, _goes_on),
    'grow': Scenario(_some, _own, _goes_on),
    'grow after a crash': Scenario(_crashed, _own, _goes_on),
    'save': Scenario(_some, _save, _old_or_new),
    'save over a crash': Scenario(_crashed, _save, _old_or_new),
    'unlink': Scenario(_some, _unlink, _linked_or_not),
    'link': Scenario(_unlinked, _link, _links_again),
    'remove': Scenario(_some_more, _thin, _thinned_or_not),
    'result table': Scenario(_rows, _tabulate, _tabulated),
    'complete result table': Scenario(_older, _complete, _whole),
}


def tries(count: int, seed: int, folder: Path) -> Iterator[tuple[str, str]]:
    """Yield the name and the problem of every try."""
    draw, made = random.Random(seed), 0
    while made < count:
        commits = [draw.randint(1, _MOST_PLACES) for _ in range(3)]
        planned = [
            (name, how, call)
            for name, scenario in SCENARIOS.items()
            for last in [_try(scenario, commits, How.COUNT, 0, folder)[1]]
            for how in (How.KILL, How.TEAR, How.FULL, How.FAIL)
            for call in range(1, last + 1)
        ]
        draw.shuffle(planned)
        for name, how, call in planned[: count - made]:
            problem, calls_made = _try(SCENARIOS[name], commits, how, call, folder)
            if problem or calls_made >= call or calls_made < 0:
                made += 1
                yield f'{name} {commits}, {how.name} at call {call}', problem


def _try(
    scenario: Scenario, commits: list[int], how: How, call: int, folder: Path
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
        if code not in (
            (_DIED,) if how in (How.KILL, How.TEAR) and not is_over else (0, _REFUSED)
        ):
            return f'ended with {code}', made.value
        try:
            scenario.check(path, commits, acknowledged.value)
        except (AssertionError, MapError, OSError, IndexError) as error:
            where = traceback.extract_tb(error.__traceback__)[-1]
            return f'{error!r} ({where.name}, line {where.lineno})', made.value
    return '', made.value


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


if __name__ == '__main__':
    print_tries(tries)
