# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Measure the figures of README again, and compare what is told with what is measured.

Usage: make claims [DATA=FOLDER], or python scripts/claims.py [--data FOLDER] [--sets SET...], 11
minutes on two cores without HBST, which takes 16 minutes of one core. It reads what README tells.
A figure whose data or peer are not there is skipped, with the reason; so are times, which depend
on the machine, unless a peer's are beside them. Exit code 1 if one does not hold; a peer that
finds less here, as SIFT does on some processors, is told but no failure.
"""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass
from importlib.util import find_spec
import json
import os
from pathlib import Path
import re
import subprocess
import sys
import tempfile
import time

from convseq_ros.evaluation.data_set import open_data_set
from drives import head, progress, row

HERE = Path(__file__).resolve().parent
README = (HERE.parent / 'README.md').read_text(encoding='utf-8')
ONE_DIRECTION, OTHER = 'gardens_point_day_day', 'gardens_point_right_left'
WITHIN = 1.0  # percent: two images of 200
FEW = {'rtabmap84': 100 / 44}  # ... or one of the images whose place is known, if they are few
SETS = {  # of the columns of the second table
    'Gardens Point': ONE_DIRECTION, 'corridor': 'corridor', 'RTAB-Map': 'rtabmap84',
    'laps': 'laps', 'night': 'street_night', 'noise': 'street_noise', 'other lane': 'street_lane',
}  # fmt: skip
BEST = (  # answers: the row of the first table, the set and the methods
    ('best answer is right, single images', OTHER, ('single', 'cohog')),
    (
        'with the drive; verified',
        OTHER,
        ('convseq k=1 search=exhaustive label=driven', 'verified'),
    ),
    ('sequences', OTHER, ('convseq', 'paper')),
)
WORDS = 'orb-bow vocabulary=WORDS levels=6 direct=4'  # its sets share keypoints to learn of
METHODS = {
    'ORB, bag of words': ('orb-bow', WORDS),
    'SIFT, VLAD': ('sift-vlad', 'sift-vlad rows=0'),
    'HBST': ('hbst',),
    '**ours**': ('convseq',),
}  # fmt: skip
NEEDLESS = ONE_DIRECTION, 'sift-vlad rows=0'  # its images are large, and none is enlarged
NO_HBST = '' if find_spec('pyhbst') else 'pyhbst is not installed, which is for x86-64'
ALONE = {'OPENBLAS_NUM_THREADS': '1', 'OPENCV_FOR_THREADS_NUM': '1'}

Key = tuple[str, str]  # of a set and a method


@dataclass(frozen=True, slots=True)
class Claim:
    """A figure of README, and what was measured."""

    what: str
    told: float
    measured: float | None = None
    reason: str = ''  # why it was not measured
    within: float = WITHIN

    @property
    def holds(self) -> bool:
        if self.measured is None:
            return bool(self.reason)
        return abs(self.told - self.measured) <= self.within

    @property
    def is_less(self) -> bool:
        """Whether a peer finds less here: SIFT finds more or less by the processor."""
        is_peer = ', ' in self.what and not self.what.endswith(', ours')
        return is_peer and self.measured is not None and self.measured < self.told

    def cells(self) -> list[str]:
        if self.measured is None:
            verdict = f'skipped: {self.reason}' if self.reason else 'not measured'
            return [self.what, f'{self.told:g}', '-', verdict]
        otherwise = 'less than told' if self.is_less else 'does not hold'
        verdict = 'holds' if self.holds else otherwise
        return [self.what, f'{self.told:g}', f'{self.measured:.3g}', verdict]


@dataclass(frozen=True, slots=True)
class Table:
    """What peers.py printed, by set and method."""

    recalls: dict[Key, float]  # percent
    times_ms: dict[Key, float]  # of the processor, for a frame


def output_of(*words: str) -> str:
    """Return what a Python program of one thread prints."""
    started, environment = time.monotonic(), {**os.environ, **ALONE}
    done = subprocess.run(
        [sys.executable, *words], capture_output=True, text=True, env=environment, check=False
    )
    if done.returncode:
        progress(done.stderr)
        done.check_returncode()
    progress(f'{time.monotonic() - started:.0f} s: {" ".join(words)}')
    return done.stdout


def why_absent(name: str, data: Path) -> str:
    """Return why a set cannot be measured, or nothing."""
    if name == 'laps':
        paths = [data / 'laps']
    else:
        found = open_data_set(name, data)
        paths = [part.path for part in (found.query, found.reference) if part and part.path.parts]
    return next((f'{path} is missing' for path in paths if not path.exists()), '')


def numbers(label: str) -> list[float]:
    """Return the figures in the result of a row of the first table, bold or after a colon."""
    (line,) = (line for line in README.splitlines() if line.startswith(f'| {label}'))
    return [float(number) for number in re.findall(r'(?:\*\*|: )([\d.]+)', line.split('|')[3])]


def best_answers(data: Path, label: str, name: str, methods: Sequence[str]) -> list[Claim]:
    """Return the claims on best answers, of ours and of the paper's method; some have a label."""
    reason, found = why_absent(name, data), dict[str, float]()
    if not reason:
        with tempfile.TemporaryDirectory() as folder:
            asked = [word for method in methods for word in ('--method', method)]
            how = '--data-root', str(data), '--output', folder, '--threads', '1', '--json'
            text = output_of('-m', 'convseq_ros.cli', 'evaluate', name, *asked, *how)
        for one in json.loads(text):
            found[one['method']] = 100 * one['accuracy_matched']
    return [
        Claim(f'{label}, {method}', told, found.get(method.partition('=')[0]), reason)
        for method, told in zip(methods, numbers(label), strict=False)
    ]


def other_circuit(data: Path) -> list[Claim]:
    """Return the claim on a circuit that is not mapped."""
    measured, reason = None, why_absent('laps', data)
    if not reason:
        how = '--data', str(data / 'laps'), '--threads', '1', '--only', 'other circuit'
        *_, line = output_of(str(HERE / 'laps.py'), *how).splitlines()
        measured = float(line.split('|')[5])
    (told,) = numbers('another circuit')
    return [Claim('another circuit, false', told, measured, reason, within=0)]


def best_recalls(data: Path, sets: Sequence[str], methods: Sequence[str]) -> Table:
    """Return the recall and the time of methods on sets; the best of several variants counts."""
    where = str(HERE / 'peers.py'), '--data', str(data)
    tables = output_of(*where, '--sets', *sets, '--methods', *methods).split('\n\n')
    recalls, times_ms = dict[Key, float](), dict[Key, float]()
    for lines in (table.splitlines() for table in tables if table.strip()):
        what, *names = _cells(lines[0])
        for method, *told in map(_cells, lines[2:]):
            for name, cell in zip(names, told, strict=True):
                key = name, method.split(',')[0]
                if what == 'best, %':
                    recalls[key] = max(float(cell), recalls.get(key, 0.0))
                elif what == 'ms a frame':
                    times_ms.setdefault(key, float(cell.strip('< ')))
    return Table(recalls, times_ms)


def _cells(line: str) -> list[str]:
    return [cell.strip(' *') for cell in line.split('|')[1:-1]]


def started_recalls(pool: Executor, data: Path, sets: Sequence[str]) -> list[Future[Table]]:
    """Start what measures recalls: the words of all sets, which takes longest, and each set."""
    if not sets:
        return []
    names = [line.split('|')[1] for line in recall_lines()[2:]]
    methods = [one for name in names for one in METHODS.get(name, (name.lower(),))]
    quick = [one for one in methods if one != WORDS and not (one == 'hbst' and NO_HBST)]
    tables = [pool.submit(best_recalls, data, sets, [WORDS])]
    for name in sets:
        asked = [one for one in quick if (name, one) != NEEDLESS]
        tables.append(pool.submit(best_recalls, data, [name], asked))
    return tables


def recall_lines() -> list[str]:
    """Return the lines of the table of methods and sets."""
    return README[README.index('| |Gardens Point') :].split('\n\n')[0].splitlines()


def time_of_peer(tables: Sequence[Table], reason: str) -> Claim:
    """Return the claim on the time of a frame, as a share of that of the peer in the same run."""
    label = "a frame, beside ORB's bag of words"
    of = {key[1]: ms for one in tables for key, ms in one.times_ms.items() if key[0] == 'laps'}
    measured = None if reason else of['ours'] / of['orb-bow']
    return Claim(label, numbers(label)[0], measured, reason, within=0.1)


def recalls(found: Mapping[Key, float], reasons: Mapping[str, str]) -> Iterator[Claim]:
    """Yield the claims of the table of methods and sets; `reasons` say which sets are skipped."""
    for line in recall_lines()[2:]:
        _, name, *told, _ = line.split('|')
        own = {'**ours**': 'ours'}.get(name, METHODS.get(name, (name,))[0])
        for (place, reason), figure in zip(reasons.items(), told, strict=True):
            why = reason or (NO_HBST if name == 'HBST' else '')
            recall = found.get((place, own))
            within = FEW.get(place, WITHIN) + 0.5  # README's figures are rounded
            yield Claim(f'{place}, {own}', float(figure), recall, why, within)


def claims(data: Path, sets: Sequence[str], pool: Executor) -> Iterator[Claim]:
    """Start all that measures, and yield the claims in README's order."""
    columns = [SETS[name.strip('\\* ')] for name in recall_lines()[0].split('|')[2:-1]]
    reasons = {name: why_absent(name, data) for name in columns}
    reasons |= {name: 'not asked for' for name in columns if name not in sets}
    answers = [pool.submit(best_answers, data, *one) for one in BEST]
    answers.append(pool.submit(other_circuit, data))
    tables = started_recalls(pool, data, [name for name in columns if not reasons[name]])
    for part in answers:
        yield from part.result()
    results, found = [table.result() for table in tables], dict[Key, float]()
    for table in results:
        for key, recall in table.recalls.items():
            found[key] = max(recall, found.get(key, 0.0))
    yield time_of_peer(results, reasons['laps'])
    yield from recalls(found, reasons)
    (told, *_) = numbers('a frame, 10,000')
    yield Claim('a frame, 10,000 places, ms', told, None, 'python -m bench')


def main() -> int:
    """Measure and print; 1 if a figure does not hold."""
    parser = argparse.ArgumentParser(allow_abbrev=False, description=__doc__.splitlines()[1])
    default = HERE.parents[1] / 'shared' / 'data'
    parser.add_argument('--data', type=Path, default=default, help='folder of data sets')
    parser.add_argument('--sets', nargs='*', default=[*SETS.values()], help='of the table')
    chosen = parser.parse_args()
    pool, hold = ThreadPoolExecutor(len(os.sched_getaffinity(0))), list[bool]()
    head('figure', 'README', 'measured', 'verdict')
    try:
        for claim in claims(chosen.data, chosen.sets, pool):
            row(*claim.cells())
            hold.append(claim.holds or claim.is_less)
    finally:
        pool.shutdown(cancel_futures=True)
    return int(not all(hold))


if __name__ == '__main__':
    raise SystemExit(main())
