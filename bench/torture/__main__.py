# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Attack the program: `python -m bench.torture [ATTACK ...]`, from the repository.

docs/RELIABILITY.md says what each attack does, and what must hold. What came of it so far is
printed after every portion. The exit code is 1 if there was a problem.
"""

import argparse
from collections.abc import Sequence
import sys
import time

from bench.torture.attack import ATTACKS, carry_out, Outcome

_SEED = 16  # the first


def main(arguments: Sequence[str] | None = None) -> int:
    """Make a portion of each chosen attack, and again with the next seed until time is over."""
    parser = argparse.ArgumentParser(
        allow_abbrev=False, prog='torture', description=__doc__.splitlines()[1]
    )
    parser.add_argument('attacks', nargs='*', metavar='ATTACK', help=f'of {", ".join(ATTACKS)}')
    parser.add_argument('--count', type=int, help='tries with one seed')
    parser.add_argument('--seed', type=int, default=_SEED, help=f'the first one ({_SEED})')
    parser.add_argument('--hours', type=float, default=0.0, help='repeat for this time')
    chosen = parser.parse_args(arguments)
    if unknown := {*chosen.attacks} - {*ATTACKS}:
        parser.error(f'{unknown.pop()}: no such attack; known are {", ".join(ATTACKS)}')
    until_s = time.monotonic() + chosen.hours * 3600
    outcomes = [Outcome(name, chosen.seed) for name in chosen.attacks or ATTACKS]
    while True:
        for outcome in outcomes:
            carry_out(outcome, chosen.count)
            print(outcome, *outcome.problems, sep='\n  ', flush=True)
        if time.monotonic() >= until_s:
            return int(any(outcome.problems for outcome in outcomes))


if __name__ == '__main__':
    sys.exit(main())
