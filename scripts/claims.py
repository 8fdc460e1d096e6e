# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Measure the figures of README again, and compare what is told with what is measured.

Usage: make claims [DATA=FOLDER], or python scripts/claims.py [--data FOLDER] [--sets SET...],
an estimated 35 minutes on an idle core, 15 of them for ORB's words. It reads what README tells. A
figure whose data are not there is skipped, with the reason; so are times, which depend on the
machine, and HBST, which takes an hour. Exit code 1 if one does not hold.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
import json
from pathlib import Path
import re
import subprocess
import sys
import tempfile

from convseq_ros.evaluation.data_set import open_data_set
from drives import head, row

HERE = Path(__file__).resolve().parent
README = (HERE.parent / 'README.md').read_text(encoding='utf-8')
ONE_DIRECTION, OTHER = 'gardens_point_day_day', 'gardens_point_right_left'
WITHIN = 1.0  # percent: two images of 200
SETS = {  # of the columns of the second table
    'Gardens Point': ONE_DIRECTION, 'corridor': 'corridor', 'RTAB-Map': 'rtabmap84',
    'laps': 'laps', 'night': 'street_night', 'noise': 'street_noise', 'other lane': 'street_lane',
}  # fmt: skip
METHODS = {
    'ORB, bag of words': ('orb-bow', 'orb-bow+vocabulary=WORDS+levels=6+direct=4'),
    'SIFT, VLAD': ('sift-vlad', 'sift-vlad+rows=0'),
    '**ours**': ('convseq',),
}  # fmt: skip
SLOW = {'HBST': 'takes an hour: scripts/peers.py --methods hbst'}


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
        return self.measured is None or abs(self.told - self.measured) <= self.within

    def cells(self) -> list[str]:
        if self.measured is None:
            return [self.what, f'{self.told:g}', '-', f'skipped: {self.reason}']
        verdict = 'holds' if self.holds else 'does not hold'
        return [self.what, f'{self.told:g}', f'{self.measured:.1f}', verdict]


def output_of(*words: str) -> str:
    """Return what a Python program prints."""
    done = subprocess.run([sys.executable, *words], stdout=subprocess.PIPE, text=True, check=True)
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


def best_answers(data: Path) -> Iterator[Claim]:
    """Yield the claims on best answers, of ours and of the paper's method."""
    for label, name, methods in (
        ('best answer is right, single images', OTHER, ('single', 'cohog')),
        ('best answer is right, sequences', ONE_DIRECTION, ('convseq', 'paper')),
    ):
        told = numbers(label)
        reason, found = why_absent(name, data), dict[str, float]()
        if not reason:
            with tempfile.TemporaryDirectory() as folder:
                asked = [word for method in methods for word in ('--method', method)]
                where = '--data-root', str(data), '--output', folder
                text = output_of(
                    '-m', 'convseq_ros.cli', 'evaluate', name, *asked, *where, '--json'
                )
            for one in json.loads(text):
                found[one['method']] = 100 * one['accuracy_matched']
        for method, figure in zip(methods, told, strict=False):
            yield Claim(f'{label}, {method}', figure, found.get(method), reason)


def other_circuit(data: Path) -> Iterator[Claim]:
    """Yield the claim on a circuit that is not mapped."""
    measured, reason = None, why_absent('laps', data)
    if not reason:
        table = output_of(str(HERE / 'laps.py'), '--data', str(data / 'laps'))
        (line,) = (line for line in table.splitlines() if 'other circuit' in line)
        measured = float(line.split('|')[5])
    (told,) = numbers('another circuit')
    yield Claim('another circuit, false', told, measured, reason, within=0)


def recalls(data: Path, sets: Sequence[str]) -> Iterator[Claim]:
    """Yield the claims of the table of methods and sets."""
    heading, *lines = README[README.index('| |Gardens Point') :].split('\n\n')[0].splitlines()
    columns = [SETS[name.strip('\\* ')] for name in heading.split('|')[2:-1]]
    names = [line.split('|')[1] for line in lines[1:]]
    reasons = {name: why_absent(name, data) for name in columns}
    reasons |= {name: 'not asked for' for name in columns if name not in sets}
    there, measured = (
        [name for name in columns if not reasons[name]],
        dict[tuple[str, str], float](),
    )
    if there:
        words = [str(HERE / 'peers.py'), '--data', str(data), '--sets', *there, '--methods']
        quick = [name for name in names if name not in SLOW]
        words += [one for name in quick for one in METHODS.get(name, (name.lower(),))]
        place = ''
        for line in output_of(*words).split('\n\n')[0].splitlines()[2:]:
            name, method, _, best, *_ = (cell.strip(' *') for cell in line.split('|')[1:])
            place = name or place
            method = method.split(',')[0]  # of several, the best counts
            measured[place, method] = max(float(best), measured.get((place, method), 0.0))
    for line, name in zip(lines[1:], names, strict=True):
        own = {'**ours**': 'ours'}.get(name, METHODS.get(name, (name,))[0])
        for place, figure in zip(columns, line.split('|')[2:-1], strict=True):
            found, reason = measured.get((place, own)), reasons[place] or SLOW.get(name, '')
            yield Claim(f'{place}, {own}', float(figure), found, reason, WITHIN + 0.5)


def main() -> int:
    """Measure and print; 1 if a figure does not hold."""
    parser = argparse.ArgumentParser(allow_abbrev=False, description=__doc__.splitlines()[1])
    default = HERE.parents[1] / 'shared' / 'data'
    parser.add_argument('--data', type=Path, default=default, help='folder of data sets')
    parser.add_argument('--sets', nargs='*', default=[*SETS.values()], help='of the table')
    chosen = parser.parse_args()
    head('figure', 'README', 'measured', 'verdict')
    claims = list[Claim]()
    for part in (
        best_answers(chosen.data),
        other_circuit(chosen.data),
        recalls(chosen.data, chosen.sets),
        [Claim('a frame, 10,000 places, ms', numbers('a frame')[0], None, 'python -m bench')],
    ):
        for claim in part:
            row(*claim.cells())
            claims.append(claim)
    return int(not all(claim.holds for claim in claims))


if __name__ == '__main__':
    raise SystemExit(main())
