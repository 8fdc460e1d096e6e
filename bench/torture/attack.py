# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What an attack is: a file of this folder.

It has `ABOUT`, what is done, `ORACLE`, what must hold after every try, and a `SEED`.
`make torture` makes `COUNT` tries, `PORTION` at a time and each portion by the next seed; the
tests make `SHORT`. `run(count, seed, folder)` yields a `Try` for each; a seed gives the same tries
again.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
import importlib
from pathlib import Path
import time

_REPOSITORY = Path(__file__).resolve().parents[2]


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
    portion: int
    short: int
    seed: int
    run: Callable[[int, int, Path], Iterator[Try]]


@dataclass(slots=True)
class Outcome:
    """What came of an attack so far; portions that were made have the seeds from `seed` on."""

    attack: str
    about: str
    oracle: str
    seed: int
    portions: int = 0
    asked: int = 0  # tries, or for each decoder where there are many
    tries: int = 0
    survived: int = 0
    seconds: float = 0.0
    problems: list[str] = field(default_factory=list)
    mended: list[str] = field(default_factory=list)  # problems of portions that held when repeated
    code: list[str] = field(default_factory=list)  # commits that were attacked


def attacks() -> dict[str, Attack]:
    """Return every attack, by name."""
    found = {}
    for path in sorted(Path(__file__).parent.glob('*.py')):
        if path.name.startswith('_'):
            continue
        module = importlib.import_module(f'bench.torture.{path.stem}')
        if hasattr(module, 'ORACLE'):
            texts = module.ABOUT, module.ORACLE
            numbers = module.COUNT, module.PORTION, module.SHORT, module.SEED
            found[path.stem] = Attack(path.stem, *texts, *numbers, module.run)
    return found


def carry_out(attack: Attack, count: int, outcome: Outcome, folder: Path) -> None:
    """Try as often as asked, by the next seed, with what that needs in a folder; count it."""
    started_s, seed = time.monotonic(), outcome.seed + outcome.portions
    tries, problems = 0, []
    for one in attack.run(count, seed, folder):
        tries += 1
        if one.problem:
            text = f'seed {seed}, {one.name}: {one.problem}'
            problems.append(text.replace(f'{_REPOSITORY}/', ''))
    outcome.portions += 1
    outcome.asked += count
    outcome.tries += tries
    outcome.survived += tries - len(problems)
    outcome.seconds = round(outcome.seconds + time.monotonic() - started_s, 1)
    outcome.problems += problems
