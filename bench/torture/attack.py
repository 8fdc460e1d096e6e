# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
An attack is a module of this folder.

`ABOUT` describes it, `ORACLE` is the condition after every try, and `SEED` the first seed.
`make torture` makes `COUNT` tries in portions of `PORTION`, each with the next seed. The tests
make `SHORT` tries. `run(count, seed, folder)` yields a `Try` per try; a seed always gives the same
tries.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
import importlib
from pathlib import Path
import time
from typing import NamedTuple, Protocol

_REPOSITORY = Path(__file__).resolve().parents[2]


class Try(NamedTuple):
    """One try: a name that allows to repeat it, and the problem, empty if there was none."""

    name: str
    problem: str = ''


class Attack(Protocol):
    """A module of this folder that attacks."""

    ABOUT: str
    ORACLE: str
    COUNT: int
    PORTION: int
    SHORT: int
    SEED: int
    run: Callable[[int, int, Path], Iterator[Try]]


@dataclass(slots=True)
class Outcome:
    """The results of an attack so far; completed portions have the seeds from `seed` on."""

    attack: str
    seed: int
    portions: int = 0
    asked: int = 0  # requested tries, per decoder if there are several
    tries: int = 0
    survived: int = 0
    seconds: float = 0.0
    problems: list[str] = field(default_factory=list)
    code: list[str] = field(default_factory=list)  # commits that were attacked


def attacks() -> dict[str, Attack]:
    """Return every attack, by name."""
    names = [path.stem for path in sorted(Path(__file__).parent.glob('[a-z]*.py'))]
    modules = {name: importlib.import_module(f'bench.torture.{name}') for name in names}
    return {name: module for name, module in modules.items() if hasattr(module, 'ORACLE')}


def carry_out(attack: Attack, count: int, outcome: Outcome, folder: Path) -> None:
    """Make `count` tries with the next seed in a folder, and add them to the outcome."""
    started_s, seed = time.monotonic(), outcome.seed + outcome.portions
    for attempt in attack.run(count, seed, folder) if count else ():
        outcome.tries += 1
        outcome.survived += not attempt.problem
        if attempt.problem:
            text = f'seed {seed}, {attempt.name}: {attempt.problem}'
            outcome.problems.append(text.replace(f'{_REPOSITORY}/', ''))
    outcome.portions += 1
    outcome.asked += count
    outcome.seconds = round(outcome.seconds + time.monotonic() - started_s, 1)
