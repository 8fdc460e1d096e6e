# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Attack the program: `python -m bench.torture [ATTACK ...]`, from the repository.

Every attack has a count, a seed and an oracle; docs/RELIABILITY.md says what came of it, and is
written after every portion, so that a night that is broken off is not lost. The exit code is 1 if
anything broke.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
import subprocess
import sys
import tempfile
import time

from bench.torture.attack import Attack, attacks, carry_out, Outcome
from bench.torture.page import keep_outcome, kept_outcome


def main(arguments: Sequence[str] | None = None) -> int:
    """Carry out the attacks that are asked for; then again and again, if there is time."""
    known = attacks()
    chosen = _parser(list(known)).parse_args(arguments)
    until_s = time.monotonic() + chosen.hours * 3600
    outcomes = {
        name: _begun(
            known[name], chosen.seed, chosen.docs if chosen.go_on or chosen.again else None
        )
        for name in chosen.attacks or known
    }
    if chosen.again:
        for name, outcome in outcomes.items():
            _repeat(known[name], outcome, chosen.docs)
            _say(outcome)
        return int(any(outcome.problems for outcome in outcomes.values()))
    for name, outcome in outcomes.items():
        count = chosen.count or known[name].count
        if chosen.seed is not None:
            count = chosen.count or known[name].portion
        if chosen.short:
            count = known[name].short
        while outcome.asked < count:
            _portion(known[name], count - outcome.asked, outcome, chosen.docs)
        _say(outcome)
    while time.monotonic() < until_s:
        for name, outcome in outcomes.items():
            _portion(known[name], known[name].portion, outcome, chosen.docs)
            _say(outcome)
    return int(any(outcome.problems for outcome in outcomes.values()))


def _begun(attack: Attack, seed: int | None, docs: Path | None) -> Outcome:
    """Return what is kept of an attack, else the outcome of no try."""
    begun = docs and kept_outcome(docs, attack.name)
    fresh = Outcome(
        attack.name, attack.about, attack.oracle, attack.seed if seed is None else seed
    )
    return replace(begun, about=attack.about, oracle=attack.oracle) if begun else fresh


def _portion(attack: Attack, most: int, outcome: Outcome, docs: Path | None) -> None:
    with tempfile.TemporaryDirectory(prefix='convseq_torture_') as folder:
        carry_out(attack, min(most, attack.portion), outcome, Path(folder))
    if docs:
        outcome.code = sorted({*outcome.code, _commit()})
        keep_outcome(docs, outcome)


def _repeat(attack: Attack, outcome: Outcome, docs: Path) -> None:
    """Make the portions again that something broke; what holds now is mended."""
    seeds = {int(text.partition(',')[0].removeprefix('seed ')) for text in outcome.problems}
    for seed in sorted(seeds):
        again = replace(outcome, seed=seed, portions=0, problems=[])
        with tempfile.TemporaryDirectory(prefix='convseq_torture_') as folder:
            carry_out(attack, attack.portion, again, Path(folder))
        if not again.problems:
            own = [text for text in outcome.problems if text.startswith(f'seed {seed},')]
            outcome.problems = [text for text in outcome.problems if text not in own]
            outcome.mended += own
            keep_outcome(docs, outcome)


def _commit() -> str:
    command = ['git', 'describe', '--always', '--exclude=*']
    told = subprocess.run(command, capture_output=True, text=True, check=False)
    return told.stdout.strip() or 'unknown'


def _say(outcome: Outcome) -> None:
    print(
        f'{outcome.attack}: {outcome.survived} of {outcome.tries} in {outcome.seconds:.0f} s, '
        f'seeds {outcome.seed} to {outcome.seed + outcome.portions - 1}',
        *outcome.problems,
        sep='\n  ',
        flush=True,
    )


def _parser(names: list[str]) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='torture', description=__doc__.splitlines()[1])
    parser.add_argument('attacks', nargs='*', metavar='ATTACK', help=f'of {", ".join(names)}')
    parser.add_argument('--count', type=int, help='tries, instead of what each file says')
    parser.add_argument('--short', action='store_true', help='as few tries as the tests make')
    parser.add_argument('--seed', type=int, help='a portion by this seed, as it was made before')
    parser.add_argument('--hours', type=float, default=0.0, help='go on for so long')
    parser.add_argument('--docs', type=Path, help='write RELIABILITY.md and its JSON there')
    parser.add_argument('--go-on', action='store_true', help='add to what is in the JSON there')
    parser.add_argument('--again', action='store_true', help='repeat portions that broke there')
    return parser


if __name__ == '__main__':
    sys.exit(main())
