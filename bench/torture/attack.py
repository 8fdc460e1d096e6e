# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Attacks, what they have in common, and how a portion of one is carried out."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
import importlib
import json
from pathlib import Path
import subprocess
import sys
import time
from typing import NamedTuple

_REPOSITORY = Path(__file__).resolve().parents[2]
_MODULES = 'damage', 'disk_attacks', 'fuzz', 'hostile_maps', 'kills', 'messages', 'odd_words'


class Try(NamedTuple):
    """One try: a name that allows to repeat it, and the problem, empty if there was none."""

    name: str
    problem: str = ''


@dataclass(frozen=True, slots=True)
class Attack:
    """What is tried, and what must hold; a module of this folder has some in its `ATTACKS`."""

    about: str
    oracle: str  # the condition after every try
    count: int  # tries of `make torture`
    portion: int  # tries with one seed
    short: int  # tries of the tests
    # Makes a count of tries with a seed in an empty folder; a seed always gives the same ones.
    run: Callable[[int, int, Path], Iterator[Try]]
    # The environment of a process that makes the tries; None if this one does.
    surroundings: Callable[[Path], dict[str, str]] | None = None


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
    modules = (importlib.import_module(f'bench.torture.{name}') for name in _MODULES)
    return dict(sorted(item for module in modules for item in module.ATTACKS.items()))


def carry_out(count: int, outcome: Outcome, folder: Path) -> None:
    """Make `count` tries with the next seed in a folder, and add them to the outcome."""
    name, seed = outcome.attack, outcome.seed + outcome.portions
    attack = attacks()[name]
    started_s = time.monotonic()
    make = attack.run if attack.surroundings is None else _elsewhere(name, attack.surroundings)
    for attempt in make(count, seed, folder):
        outcome.tries += 1
        outcome.survived += not attempt.problem
        if attempt.problem:
            text = f'seed {seed}, {attempt.name}: {attempt.problem}'
            outcome.problems.append(text.replace(f'{_REPOSITORY}/', ''))
    outcome.portions += 1
    outcome.asked += count
    outcome.seconds = round(outcome.seconds + time.monotonic() - started_s, 1)


def _elsewhere(
    name: str, surroundings: Callable[[Path], dict[str, str]]
) -> Callable[[int, int, Path], Iterator[Try]]:
    """Return a run that makes the tries in another process."""

    def run(count: int, seed: int, folder: Path) -> Iterator[Try]:
        command = [sys.executable, '-m', __spec__.name, name, str(count), str(seed), str(folder)]
        own = surroundings(folder)
        with subprocess.Popen(command, env=own, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout
            for line in process.stdout:
                yield Try(*json.loads(line))
        if process.returncode:
            yield Try('all', f'ended with {process.returncode}')

    return run


def print_tries(name: str, count: str, seed: str, folder: str) -> None:
    """Make tries, and print each as a line of JSON."""
    for attempt in attacks()[name].run(int(count), int(seed), Path(folder)):
        print(json.dumps(attempt), flush=True)


if __name__ == '__main__':
    print_tries(*sys.argv[1:])
