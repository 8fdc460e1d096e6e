# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What an attack is: a file of this folder.

It has `ABOUT`, what is done, `ORACLE`, what must hold after every try, and a `SEED`.
`make torture` makes `COUNT` tries, the tests `SHORT`. `run(count, seed, folder)` yields a `Try`
for each; a seed gives the same tries again.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
import importlib
from pathlib import Path
import time


@dataclass(frozen=True, slots=True)
class Try:
    """
    One try.

    Parameters
    ----------
    name : str
        What was tried, enough to try it again.
    problem : str
        What did not hold; empty if all did.

    """

    name: str
    problem: str = ''


@dataclass(frozen=True, slots=True)
class Attack:
    """A file of this folder."""

    name: str
    about: str
    oracle: str
    count: int
    short: int
    seed: int
    run: Callable[[int, int, Path], Iterator[Try]]


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of an attack."""

    attack: str
    about: str
    oracle: str
    tries: int
    survived: int
    seed: int
    seconds: float
    problems: list[str]


def attacks() -> dict[str, Attack]:
    """Return every attack, by name."""
    found = {}
    for path in sorted(Path(__file__).parent.glob('*.py')):
        if path.name.startswith('_'):
            continue
        module = importlib.import_module(f'bench.torture.{path.stem}')
        if hasattr(module, 'ORACLE'):
            values = (module.ABOUT, module.ORACLE, module.COUNT, module.SHORT, module.SEED)
            found[path.stem] = Attack(path.stem, *values, module.run)
    return found


def carry_out(attack: Attack, count: int, seed: int, folder: Path) -> Outcome:
    """Try as often as asked, with what that needs in a folder."""
    started_s = time.monotonic()
    tries, problems = 0, []
    for one in attack.run(count, seed, folder):
        tries += 1
        if one.problem:
            problems.append(f'{one.name}: {one.problem}')
    return Outcome(
        attack.name,
        attack.about,
        attack.oracle,
        tries,
        tries - len(problems),
        seed,
        round(time.monotonic() - started_s, 1),
        problems,
    )
