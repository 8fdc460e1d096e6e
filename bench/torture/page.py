# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Writes docs/RELIABILITY.md from the results of the attacks."""

from collections.abc import Mapping
from dataclasses import asdict
import json
import os
from pathlib import Path
import platform
from typing import Any

from convseq_ros.evaluation.run_folder import write_text

from bench.torture.attack import attacks, Outcome

_MOST_PROBLEMS = 5
_HEAD = """# Reliability

What was tried to break convseq_ros, and did it hold? `make torture` writes this page, and
`reliability.json` with seeds and commits. An attack stands in
[bench/torture](../bench/torture); `python -m bench.torture NAME --seed N` makes a portion again,
and `make torture HOURS=24` goes on for a night.

| attack | what is done | what must hold | survived |
|---|---|---|---|
"""
_MUTANTS = """
`fuzz` needs `pip install '.[torture]'`. Inputs that break a decoder are kept in `convseq_fuzz`,
where temporary files are, and become tests: what did not survive and is not listed here is mended.

## Mutants

`scripts/mutate.py` changes one operator, condition or call of `core/decision`, `core/pose` and
`core/map` at a time: do the tests of the core see it?

| command | commit | what came of it |
|---|---|---|
"""
_SOAK = """
## Soak

A drawn town is driven through the real node for hours. Does anything grow, with time or with
places?

| command | what came of it |
|---|---|
"""
_SOAKS = {
    'soak_preloaded_10_hz': '--mode preloaded --rate 10 --minutes 100',
    'soak_online_fast': '--mode online --frames 288000',
}


def keep_outcome(docs: Path, outcome: Outcome) -> None:
    """Store the outcome of an attack in place of the previous one, and write the page."""
    kept = _read(docs)
    kept['outcomes'][outcome.attack] = asdict(outcome)
    kept['machine'] = {
        'Python': platform.python_version(),
        'system': platform.platform(),
        'processors': os.cpu_count(),
        'load': round(os.getloadavg()[2]),
    }
    _write(kept, docs)


def keep_soak(docs: Path, name: str, command: str, text: str) -> None:
    """Store the result of a soak, with the picture images/NAME.png, and write the page."""
    kept = _read(docs)
    kept['soaks'][name] = {'command': command, 'text': text}
    _write(kept, docs)


def _read(docs: Path) -> dict[str, Any]:
    path = docs / 'reliability.json'
    kept = {'outcomes': {}, 'mutants': [], 'soaks': {}, 'machine': {}}
    return kept | (json.loads(path.read_text(encoding='utf-8')) if path.exists() else {})


def _write(kept: dict[str, Any], docs: Path) -> None:
    known = attacks()
    kept['outcomes'] = {name: one for name, one in kept['outcomes'].items() if name in known}
    write_text(docs / 'reliability.json', json.dumps(kept, indent=1, sort_keys=True) + '\n')
    write_text(docs / 'RELIABILITY.md', _page(kept))


def _page(kept: Mapping[str, Any]) -> str:
    outcomes: dict[str, Any] = kept['outcomes']
    lines = [_HEAD.strip()]
    for name, attack in attacks().items():
        row = f'| `{name}` | {attack.about} | {attack.oracle} |'
        if not (one := outcomes.get(name)):
            lines.append(f'{row} *not run* |')
            continue
        lines.append(f'{row} {one["survived"]:,} of {one["tries"]:,} |')
    for one in outcomes.values():
        if one['problems']:
            lines += ['', f'What `{one["attack"]}` broke:', '']
            some = one['problems'][:_MOST_PROBLEMS]
            lines += [f'* {" ".join(text.split())}' for text in some]
    lines += _MUTANTS.rstrip().splitlines()
    for one in kept['mutants']:
        lines.append(f'| `{one["command"]}` | {one["commit"]} | {one["text"]} |')
    lines += _SOAK.rstrip().splitlines()
    for name, command in _SOAKS.items():
        one = kept['soaks'].get(name)
        said = f'{one["text"]}; [picture](images/{name}.png)' if one else '*not run*'
        lines.append(f'| `python -m bench.soak {one["command"] if one else command}` | {said} |')
    lines += ['', 'Measured on: ' + ', '.join(f'{k} {v}' for k, v in kept['machine'].items())]
    return '\n'.join(lines) + '\n'
