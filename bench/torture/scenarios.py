# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What changes files: maps are made, grown, saved, linked, thinned."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
import tempfile

from convseq_ros.core.map.appender import Appender
from convseq_ros.core.map.edit import unlink
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.session_slice import joined, slices_of, without
from convseq_ros.core.map.writer import rewrite, save_map
from convseq_ros.errors import MapError

from bench.torture.disk import acknowledge, heal
from bench.torture.maps import answers, APART, crash, drawn, ENCODING, grow, holds, log_of

Commits = tuple[int, ...]  # counts of places in each


@dataclass(frozen=True, slots=True)
class Scenario:
    """Something that changes files."""

    prepare: Callable[[Path, Commits], None]  # creates the initial files
    # The work; it acknowledges the number that must be there from then on, or 1 when it is done.
    act: Callable[[Path, Commits], None]
    # The check; AssertionError if the files do not fit the acknowledged number.
    check: Callable[['Scenario', Path, Commits, int], None]


def _nothing(_path: Path, _commits: Commits) -> None: ...


def _some(path: Path, commits: Commits) -> None:
    save_map(drawn(commits[0]), path)


def _crashed(path: Path, commits: Commits) -> None:
    """Create a map after a crash in the middle of a commit, with its committed places."""
    crash(path, commits[0], commits[0] + commits[1])
    with log_of(path).open('r+b') as log:
        log.truncate(log_of(path).stat().st_size - 1)


def _grow(path: Path, commits: Commits) -> None:
    owner = Appender(path, ENCODING, APART)
    acknowledge(owner.committed)
    try:
        for count in commits:
            grow(owner.reference_map, count)
            try:
                owner.flush()
            except MapError:
                heal()  # the disk has space again
                owner.flush()
            acknowledge(owner.committed)
    finally:
        owner.close()
    assert owner.committed == len(owner.reference_map)


def _save(path: Path, commits: Commits) -> None:
    save_map(drawn(sum(commits), 1), path)
    acknowledge(1)


def _unlink(path: Path, commits: Commits) -> None:
    unlink(path, range(commits[0]))
    acknowledge(1)


def _remove(path: Path, commits: Commits) -> None:
    rewrite(path, lambda opened: joined(without(slices_of(path, opened), {commits[0] - 1})))
    acknowledge(1)


def _goes_on(_scenario: Scenario, path: Path, _commits: Commits, acknowledged: int) -> None:
    """Check that the map has all places, and that another program can extend or create it."""
    if acknowledged >= 0:
        assert holds(path) >= acknowledged
    else:
        with suppress(MapError):
            acknowledged = holds(path)
    owner = Appender(path, ENCODING, APART)
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
        scenario.act(path, commits)
    assert _content(path) == new
    unlink(path)  # the next program tidies up
    _nothing_beside(path)


@lru_cache
def _undisturbed(scenario: Scenario, name: str, commits: Commits) -> tuple[object, object]:
    """Return the content before and after the act, if nothing fails."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, name)
        scenario.prepare(path, commits)
        old = _content(path)
        scenario.act(path, commits)
        return old, _content(path)


def _content(path: Path) -> object:
    """Return what a map holds: places and links."""
    opened = open_map(path, ENCODING)
    assert not opened.problem, opened.problem
    links = [*map(repr, opened.links.each())], opened.links.looked_up_count
    return answers(path)[2:], links  # before these are identities


def _nothing_beside(path: Path) -> None:
    """Check that neither the last program nor an earlier one left temporary files."""
    beside = {one.name for one in path.parent.iterdir()} - {path.name}
    assert not beside, beside


SCENARIOS = {
    'make': Scenario(_nothing, _grow, _goes_on),
    'grow after a crash': Scenario(_crashed, _grow, _goes_on),
    'save over a crash': Scenario(_crashed, _save, _old_or_new),
    'unlink': Scenario(_some, _unlink, _old_or_new),
    'remove': Scenario(_some, _remove, _old_or_new),
}
