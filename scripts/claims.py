# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Measure the figures of README again, and compare what is told with what is measured.

Usage: make claims [DATA=FOLDER] [REAL=FOLDER] [DBOW2=CLONE], or python scripts/claims.py
[--data FOLDER] [--real FOLDER] [--places PLACE...] [--dbow2 CLONE], about an hour on two cores. It
reads what README tells; --real has the drives of real_drives.py, --dbow2 what `git clone` makes of
DBoW2. A figure whose images or peer are not there is skipped, with the reason, and so are times,
which depend on the machine. Exit code 1 if one does not hold; a peer that finds less here, as SIFT
does on some processors, is told but no failure.
"""

from argparse import Namespace
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
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
from drives import head, options, progress, row
from peers import RIGHT

HERE = Path(__file__).resolve().parent
README = (HERE.parent / 'README.md').read_text(encoding='utf-8')
ANSWERS = (  # in README's order: set and method; others' own figures are not measured
    ('gardens_point_right_left', 'single'), ('gardens_point_right_left', ''),
    ('corridor', 'single'), ('corridor', 'vprbench-hybridnet'),
    ('rtabmap84', 'single'), ('rtabmap84', 'cohog'),
)  # fmt: skip
WITHIN = 1.0  # percent: two images of 200
FEW = {'RTAB-Map': 100 / 44}  # ... or one of the images whose place is known, if they are few
ROUNDED = 0.5  # percent, in the table of places
NOT_OURS = 'others measured it'
NO_DBOW2 = 'needs --dbow2 CLONE, of https://github.com/dorian3d/DBoW2'
NO_HBST = '' if find_spec('pyhbst') else 'pyhbst is not installed, which is for x86-64'
ALONE = {'OPENBLAS_NUM_THREADS': '1', 'OPENCV_FOR_THREADS_NUM': '1'}


@dataclass(frozen=True, slots=True)
class Claim:
    """A figure of README, and what was measured."""

    what: str
    told: float
    measured: float | None = None
    reason: str = ''  # why it was not measured
    within: float = WITHIN
    is_peer: bool = False

    @property
    def holds(self) -> bool:
        if self.measured is None:
            return bool(self.reason)
        return abs(self.told - self.measured) <= self.within

    @property
    def is_less(self) -> bool:
        """Whether a peer finds less here: SIFT finds more or less by the processor."""
        return self.is_peer and self.measured is not None and self.measured < self.told

    def cells(self) -> list[str]:
        if self.measured is None:
            verdict = f'skipped: {self.reason}' if self.reason else 'not measured'
            return [self.what, f'{self.told:g}', '-', verdict]
        otherwise = 'less than told' if self.is_less else 'does not hold'
        verdict = 'holds' if self.holds else otherwise
        return [self.what, f'{self.told:g}', f'{self.measured:.3g}', verdict]


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


def cells(line: str) -> list[str]:
    """Return the cells of a row of a table."""
    return [cell.strip(' *') for cell in line.split('|')[1:-1]]


def numbers(label: str) -> list[float]:
    """Return the figures of an item of README's list, bold or after a colon."""
    item = README[README.index(f'- {label}') :].split('\n\n')[0].split('\n- ')[0]
    return [float(number) for number in re.findall(r'(?:\*\*|: )(\d+(?:\.\d+)?)', item)]


def best_answers(data: Path, name: str) -> list[Claim]:
    """Return the claims on best answers of single images of a set."""
    data_set, found = open_data_set(name, data), dict[str, float]()
    path, published = data_set.query.path, data_set.published
    reason = '' if path.exists() else f'{path} is missing'
    told = {
        of[1]: figure
        for of, figure in zip(ANSWERS, numbers('Best answers'), strict=True)
        if of[0] == name
    }
    why = {method: NOT_OURS * (not method) for method in told}
    why |= {one: f'{file} is missing' for one, file in published.items() if not file.exists()}
    if not reason:
        asked_for = [one for one in told if not why[one]]
        methods = ['published' if one in published else one for one in asked_for]
        with tempfile.TemporaryDirectory() as folder:
            asked = [word for method in methods for word in ('--method', method)]
            how = '--data-root', str(data), '--output', folder, '--threads', '1', '--json'
            text = output_of('-m', 'convseq_ros.cli', 'evaluate', name, *asked, *how)
        found = {one['method']: 100 * one['accuracy_all'] for one in json.loads(text)}
    return [
        Claim(f'{name}, {method or "others"}', figure, found.get(method), reason or why[method])
        for method, figure in told.items()
    ]


def other_circuit(data: Path) -> list[Claim]:
    """Return the claim on a circuit that is not mapped."""
    (told,), folder = numbers('Of 600 frames'), data / 'laps'
    what = 'another circuit, false'
    if not folder.exists():
        return [Claim(what, told, None, f'{folder} is missing', within=0)]
    how = '--data', str(folder), '--only', 'other circuit'
    *_, line = output_of(str(HERE / 'laps.py'), *how).splitlines()
    return [Claim(what, told, float(line.split('|')[5]), within=0)]


def of_place(line: str, titles: Sequence[str], chosen: Namespace) -> list[Claim]:
    """Return the claims of a row of the table of places."""
    place, _, own, *best = cells(line)
    methods, reason, tables = titles[3:], '', dict[str, dict[str, str]]()
    absent = {'HBST': NO_HBST, 'ORB': '' if chosen.dbow2 else NO_DBOW2}
    if place not in chosen.places:
        reason = 'not asked for'
    else:
        where = '--data', str(chosen.data), *(('--real', str(chosen.real)) * bool(chosen.real))
        asked = '--places', place, '--methods', *(name for name in methods if not absent.get(name))
        script = ('dbow2.py', str(chosen.dbow2)) if chosen.dbow2 else ('peers.py',)
        printed = output_of(f'{HERE / script[0]}', *script[1:], *where, *asked).strip()
        for table in printed.split('\n\n') if printed else ():
            columns, _, *rows = map(cells, table.splitlines())
            for one in rows:
                tables[columns[0]] = dict(zip(columns, one, strict=True))
        reason = '' if tables else 'its images are not there'
    found = tables.get('best, %', {})
    within = FEW.get(place, WITHIN) + ROUNDED
    (recall, false), measured = parts(own), tables.get('own, % (false)', {}).get('ours')
    right, wrong = parts(measured) if measured else (None, None)
    claims = [
        Claim(f'{place}, ours by its own decision', recall, right, reason, within),
        Claim(f'{place}, ours by its own decision, false', false, wrong, reason, within=0),
    ]
    for method, told in zip(methods, best, strict=True):
        if told:
            why = reason or absent.get(method, '')
            share = parts(found[method])[0] if method in found else None
            is_peer = method != 'ours'
            claims.append(Claim(f'{place}, {method}', float(told), share, why, within, is_peer))
    return claims


def parts(cell: str) -> tuple[float, float]:
    """Return a figure and the one in brackets, 0 if there is none."""
    figure, _, other = cell.partition(' (')
    return float(figure), float(other.strip(')').replace(',', '') or 0)


def claims(chosen: Namespace, pool: ThreadPoolExecutor) -> Iterator[Claim]:
    """Start all that measures, and yield the claims in README's order."""
    titles, _, *rows = README[README.index('|place|') :].split('\n\n')[0].splitlines()
    names = dict.fromkeys(name for name, _ in ANSWERS)
    started = [pool.submit(best_answers, chosen.data, name) for name in names]
    started.append(pool.submit(other_circuit, chosen.data))
    started += [pool.submit(of_place, line, cells(titles), chosen) for line in rows]
    for one in started:
        yield from one.result()
    (told,) = numbers('In a map of 10,000')
    yield Claim('a frame, 10,000 places, ms', told, None, 'python -m bench')


def main() -> int:
    """Measure and print; 1 if a figure does not hold."""
    data = HERE.parents[1] / 'shared' / 'data'
    chosen = options(__doc__, data=data, real=None, places=(*RIGHT,), dbow2=None)
    pool, hold = ThreadPoolExecutor(len(os.sched_getaffinity(0))), list[bool]()
    head('figure', 'README', 'measured', 'verdict')
    try:
        for claim in claims(chosen, pool):
            row(*claim.cells())
            hold.append(claim.holds or claim.is_less)
    finally:
        pool.shutdown(cancel_futures=True)
    return int(not all(hold))


if __name__ == '__main__':
    raise SystemExit(main())
