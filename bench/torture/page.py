# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""docs/RELIABILITY.md, from what was tried and nothing else."""

from collections.abc import Mapping
from dataclasses import asdict
import json
import os
from pathlib import Path
import platform
from typing import Any

from bench.torture.attack import attacks, Outcome

_MOST_PROBLEMS = 5
_HEAD = """# Reliability

Attacks on convseq_ros, and what came of them; written by `make torture`. An attack is a file of
[bench/torture](../bench/torture). It is made in portions, each by the next seed:
`python -m bench.torture NAME --seed N` makes a portion again, `--again --docs docs` those that
broke. `make torture HOURS=24` goes on for a night (*not run*); this page is written after every
portion, and `python -m bench.torture --docs docs --go-on` adds to what there is.

| attack | what is done | what must hold | tries | survived | seeds | commits |
|---|---|---|---|---|---|---|
"""
_TRIES = """
Each file says how many tries `make torture` makes; the table says how many were made. For `fuzz`
they are of all decoders together, {fuzz}; more come by
`python -m bench.torture fuzz --count 200000 --docs docs --go-on`. One decoder is fuzzed by
`python -m bench.torture._fuzzer 20000 16 /tmp map`, which needs `pip install '.[torture]'`.
Inputs that break one are kept in `convseq_fuzz`, where temporary files are, and become tests.
"""
_SOAK = """
## Soak

A drawn town is driven through the real node; memory, handles, threads and latency are written as a
table and a picture. Growth is what comes with time alone, and what comes with places; where places
come at a steady pace, all of it counts as theirs. Frames that were sent are answered, or counted
as dropped or lost.

| command | what came of it |
|---|---|
"""
_SOAKS = {
    'soak_preloaded_10_hz': '--mode preloaded --rate 10 --minutes 100',
    'soak_online_fast': '--mode online --frames 288000',
}


def kept_outcome(docs: Path, name: str) -> Outcome | None:
    """Return what is kept of an attack, if anything."""
    found = _read(docs)['outcomes'].get(name)
    return Outcome(**found) if found else None


def keep_outcome(docs: Path, outcome: Outcome) -> None:
    """Have what came of an attack replace what is kept of it, and write the page."""
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
    """Keep what came of a soak, whose picture is images/NAME.png, and write the page."""
    kept = _read(docs)
    kept['soaks'][name] = {'command': command, 'text': text}
    _write(kept, docs)


def _read(docs: Path) -> dict[str, Any]:
    path, kept = docs / 'reliability.json', {'outcomes': {}, 'soaks': {}, 'machine': {}}
    return kept | (json.loads(path.read_text(encoding='utf-8')) if path.exists() else {})


def _write(kept: Mapping[str, Any], docs: Path) -> None:
    _replace(docs / 'reliability.json', json.dumps(kept, indent=1, sort_keys=True) + '\n')
    _replace(docs / 'RELIABILITY.md', _page(kept))


def _replace(path: Path, text: str) -> None:
    """Write a file in one step, and wait for the disk."""
    part = path.with_name(f'{path.name}.part')
    with part.open('w', encoding='utf-8') as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    os.replace(part, path)


def _page(kept: Mapping[str, Any]) -> str:
    outcomes: dict[str, Any] = kept['outcomes']
    lines = [_HEAD.strip()]
    for name, attack in attacks().items():
        one = outcomes.get(name)
        row = f'| `{name}` | {attack.about} | {attack.oracle} |'
        if not one:
            lines.append(f'{row} *not run* | | | |')
            continue
        last = one['seed'] + one['portions'] - 1
        seeds = f'{one["seed"]}' + (f' to {last}' if last > one['seed'] else '')
        lines.append(
            f'{row} {one["tries"]:,} | {one["survived"]:,} | {seeds} | {", ".join(one["code"])} |'
        )
    for one in outcomes.values():
        for what, texts in (
            ('broke', one['problems']),
            ('broke, and holds now', one.get('mended', [])),
        ):
            if texts:
                lines += ['', f'What `{one["attack"]}` {what}:', '']
                lines += [f'* {" ".join(text.split())}' for text in texts[:_MOST_PROBLEMS]]
    lines += _TRIES.format(fuzz=_fuzzed(outcomes.get('fuzz'))).rstrip().splitlines()
    lines += _SOAK.rstrip().splitlines()
    for name, command in _SOAKS.items():
        one = kept['soaks'].get(name)
        said = f'{one["text"]}; [picture](images/{name}.png)' if one else '*not run*'
        lines.append(f'| `python -m bench.soak {one["command"] if one else command}` | {said} |')
    lines += ['', 'Measured on: ' + ', '.join(f'{k} {v}' for k, v in kept['machine'].items())]
    return '\n'.join(lines) + '\n'


def _fuzzed(one: Mapping[str, Any] | None) -> str:
    if not one:
        return '*not run*'
    return f'{one["asked"]:,} of each of {round(one["tries"] / one["asked"])}'
