# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Attack the program: `python -m bench.torture [ATTACK ...]`, from the repository.

Every attack has a count, a seed and an oracle; docs/RELIABILITY.md says what came of it. The exit
code is 1 if anything broke.
"""

import argparse
from collections.abc import Sequence
from dataclasses import asdict
import json
from pathlib import Path
import platform
import sys
import tempfile
import time

from bench.torture.attack import attacks, carry_out, Outcome
from bench.torture.page import read_kept, write_page


def main(arguments: Sequence[str] | None = None) -> int:
    """Carry out the attacks that are asked for, again and again if there is time."""
    known = attacks()
    chosen = _parser(list(known)).parse_args(arguments)
    names = chosen.attacks or list(known)
    until_s = time.monotonic() + chosen.hours * 3600
    outcomes: dict[str, Outcome] = {}
    rounds = 0
    while not rounds or time.monotonic() < until_s:
        for name in names:
            seed = known[name].seed if chosen.seed is None else chosen.seed
            count = known[name].short if chosen.short else chosen.count or known[name].count
            with tempfile.TemporaryDirectory(prefix='convseq_torture_') as folder:
                outcome = carry_out(known[name], count, seed + rounds, Path(folder))
            outcomes[name] = _joined(outcomes.get(name), outcome)
            _say(outcome)
        rounds += 1
    if chosen.docs:
        kept = read_kept(chosen.docs / 'reliability.json')
        kept['outcomes'] |= {name: asdict(outcome) for name, outcome in outcomes.items()}
        kept['not_run'] = [
            [name, one.about] for name, one in known.items() if name not in kept['outcomes']
        ]
        kept['machine'] = {'Python': platform.python_version(), 'system': platform.platform()}
        text = json.dumps(kept, indent=1) + '\n'
        (chosen.docs / 'reliability.json').write_text(text, encoding='utf-8')
        write_page(kept, chosen.docs)
    return int(any(outcome.problems for outcome in outcomes.values()))


def _joined(before: Outcome | None, now: Outcome) -> Outcome:
    if before is None:
        return now
    return Outcome(
        now.attack,
        now.about,
        now.oracle,
        before.tries + now.tries,
        before.survived + now.survived,
        before.seed,
        before.seconds + now.seconds,
        before.problems + now.problems,
    )


def _say(outcome: Outcome) -> None:
    print(
        f'{outcome.attack}: {outcome.survived} of {outcome.tries} in {outcome.seconds:.0f} s, '
        f'seed {outcome.seed}',
        *outcome.problems,
        sep='\n  ',
        flush=True,
    )


def _parser(names: list[str]) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='torture', description=__doc__.splitlines()[1])
    parser.add_argument('attacks', nargs='*', metavar='ATTACK', help=f'of {", ".join(names)}')
    parser.add_argument('--count', type=int, help='tries, instead of what each file says')
    parser.add_argument('--short', action='store_true', help='as few tries as the tests make')
    parser.add_argument('--seed', type=int, help='instead of what each file says')
    parser.add_argument('--hours', type=float, default=0.0, help='go on for so long')
    parser.add_argument('--docs', type=Path, help='write RELIABILITY.md and its JSON there')
    return parser


if __name__ == '__main__':
    sys.exit(main())
