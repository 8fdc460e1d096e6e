# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Attack the program: `python -m bench.torture [ATTACK ...]`, from the repository.

Every attack has a count, a seed and an oracle. docs/RELIABILITY.md has the results, and is written
after every portion, so that an interrupted run is not lost. The exit code is 1 if there was a
problem.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
import subprocess
import sys
import tempfile
import time

from bench.torture.attack import attacks, carry_out, Outcome
from bench.torture.page import keep_outcome

_SEED = 16  # the first


def main(arguments: Sequence[str] | None = None) -> int:
    """Carry out the chosen attacks, and repeat them until the time is over."""
    available = attacks()
    parser = _parser(list(available))
    chosen = parser.parse_args(arguments)
    if unknown := [name for name in chosen.attacks if name not in available]:
        parser.error(f'{unknown[0]}: no such attack; known are {", ".join(available)}')
    until_s = time.monotonic() + chosen.hours * 3600
    outcomes = {}
    for name in chosen.attacks or available:
        attack = available[name]
        outcomes[name] = outcome = Outcome(name, _SEED if chosen.seed is None else chosen.seed)
        count = attack.count if chosen.seed is None else attack.portion
        count = attack.short if chosen.short else count
        while outcome.asked < count:
            _portion(min(attack.portion, count - outcome.asked), outcome, chosen.docs)
        _report(outcome)
    while time.monotonic() < until_s:
        for name, outcome in outcomes.items():
            _portion(available[name].portion, outcome, chosen.docs)
            _report(outcome)
    return int(any(outcome.problems for outcome in outcomes.values()))


def _portion(count: int, outcome: Outcome, docs: Path | None) -> None:
    with tempfile.TemporaryDirectory(prefix='convseq_torture_') as folder:
        carry_out(count, outcome, Path(folder))
    if docs:
        outcome.code = sorted({*outcome.code, _commit()})
        keep_outcome(docs, outcome)


def _commit() -> str:
    command = ['git', 'describe', '--always', '--exclude=*']
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.stdout.strip() or 'unknown'


def _report(outcome: Outcome) -> None:
    print(
        f'{outcome.attack}: {outcome.survived} of {outcome.tries} in {outcome.seconds:.0f} s, '
        f'seeds {outcome.seed} to {outcome.seed + outcome.portions - 1}',
        *outcome.problems,
        sep='\n  ',
        flush=True,
    )


def _parser(names: list[str]) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        allow_abbrev=False, prog='torture', description=__doc__.splitlines()[1]
    )
    parser.add_argument('attacks', nargs='*', metavar='ATTACK', help=f'of {", ".join(names)}')
    parser.add_argument('--short', action='store_true', help='as few tries as in the tests')
    parser.add_argument('--seed', type=int, help='repeat the portion of this seed')
    parser.add_argument('--hours', type=float, default=0.0, help='repeat for this time')
    parser.add_argument('--docs', type=Path, help='write RELIABILITY.md and its JSON there')
    return parser


if __name__ == '__main__':
    sys.exit(main())
