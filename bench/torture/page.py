# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""docs/RELIABILITY.md, from what was tried and nothing else."""

from collections.abc import Mapping
import json
from pathlib import Path
from typing import Any

_MOST_PROBLEMS = 5
_HEAD = """# Reliability

Attacks on convseq_ros, and what came of them; written by `make torture`. An attack is a file of
[bench/torture](../bench/torture), with a seed: `python -m bench.torture NAME --seed N` tries the
same again. `make torture HOURS=24` goes on for a night.

| attack | what is done | what must hold | tries | survived | seed |
|---|---|---|---|---|---|
"""


def write_page(kept: Mapping[str, Any], docs: Path) -> None:
    """Write the page."""
    outcomes = list(kept['outcomes'].values())
    lines = [_HEAD.rstrip()]
    for one in outcomes:
        lines.append(
            f'| `{one["attack"]}` | {one["about"]} | {one["oracle"]} | {one["tries"]:,} | '
            f'{one["survived"]:,} | {one["seed"]} |'
        )
    lines += [f'| `{name}` | {about} | | *not run* | | |' for name, about in kept['not_run']]
    for one in outcomes:
        if one['problems']:
            lines += ['', f'What `{one["attack"]}` broke:', '']
            lines += [f'* {text}' for text in one['problems'][:_MOST_PROBLEMS]]
    lines += ['', 'Measured on: ' + ', '.join(f'{k} {v}' for k, v in kept['machine'].items())]
    (docs / 'RELIABILITY.md').write_text('\n'.join(lines) + '\n', encoding='utf-8')


def read_kept(path: Path) -> dict[str, Any]:
    """Return the outcomes of earlier runs; those of this one replace them one by one."""
    if not path.exists():
        return {'outcomes': {}, 'not_run': [], 'machine': {}}
    kept: dict[str, Any] = json.loads(path.read_text(encoding='utf-8'))
    return kept
