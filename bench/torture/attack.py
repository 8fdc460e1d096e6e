# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Carries out attacks, each in a process of its own; docs/RELIABILITY.md says what they do."""

from dataclasses import dataclass, field
import importlib
import json
from pathlib import Path
import subprocess
import sys
import tempfile
from typing import NamedTuple

from bench.torture.disk import environment

_REPOSITORY = Path(__file__).resolve().parents[2]


class Try(NamedTuple):
    """One try, or several of which the last may have a problem."""

    name: str  # that allows to repeat it
    problem: str = ''
    made: int = 1


# Each is a function of a module of this folder, which makes a number of tries with a seed in an
# empty folder; a seed always gives the same ones. The number is that of `make torture`; of `fuzz`,
# it is for each decoder.
ATTACKS = {
    'fuzz': ('fuzz', 20_000),
    'graph_kills': ('graph_kills', 20),
    'graph_numbers': ('graph_numbers', 200),
    'hostile_maps': ('hostile_maps', 100),
    'images': ('messages', 500),
    'log_damage': ('damage', 500),
    'map_damage': ('damage', 500),
    'map_kills': ('kills', 50),
    'map_power': ('disk_attacks', 200),
    'map_writes': ('disk_attacks', 100),
    'node_messages': ('messages', 20),
    'odd_words': ('odd_words', 50),
}


@dataclass(slots=True)
class Outcome:
    """The results of an attack so far."""

    attack: str
    next_seed: int
    tries: int = 0
    problems: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        survived = f'{self.tries - len(self.problems):,} of {self.tries:,}'
        return f'{self.attack}: {survived}, to seed {self.next_seed - 1}'


def carry_out(outcome: Outcome, count: int | None = None) -> None:
    """Make a portion of tries, or a count, with the next seed, in another process."""
    seed, (module, portion) = outcome.next_seed, ATTACKS[outcome.attack]
    words = outcome.attack, str(count or portion), str(seed)
    outcome.next_seed += 1
    with tempfile.TemporaryDirectory(prefix='convseq_torture_') as folder:
        command = [sys.executable, '-m', __spec__.name, *words, folder]
        own = environment(Path(folder)) if module == 'disk_attacks' else None
        with subprocess.Popen(command, env=own, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout
            for line in process.stdout:
                attempt = Try(*json.loads(line.replace(f'{_REPOSITORY}/', '')))
                outcome.tries += attempt.made
                if attempt.problem:
                    outcome.problems.append(f'seed {seed}, {attempt.name}: {attempt.problem}')
        if process.returncode:
            outcome.problems.append(f'seed {seed}: ended with {process.returncode}')


def print_tries(name: str, count: str, seed: str, folder: str) -> None:
    """Make tries, and print each as a line of JSON."""
    module = importlib.import_module(f'bench.torture.{ATTACKS[name][0]}')
    for attempt in getattr(module, name)(int(count), int(seed), Path(folder)):
        print(json.dumps(attempt), flush=True)


if __name__ == '__main__':
    print_tries(*sys.argv[1:])
