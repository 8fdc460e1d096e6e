# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the commands share that change which sessions a map holds."""

import argparse
from collections.abc import Sequence
import json
from pathlib import Path

from convseq_ros.cli.terminal import printable, progress
from convseq_ros.core.map.editing import Part, Watch

SESSION_HELP = 'name, number or id of a session, as `convseq info` shows it'


def add_json(parser: argparse.ArgumentParser) -> None:
    """Declare how the report is printed."""
    parser.add_argument('--json', action='store_true', help='print the report as JSON')


def watched(path: Path) -> Watch:
    """Return what shows how far a map is written."""
    return lambda steps: progress(steps, len(steps), path.name, '64 places')


def report(made: Sequence[tuple[Path, Sequence[Part]]], as_json: bool) -> int:
    """Print which sessions maps hold now, and where these come from."""
    facts = [
        {
            'map': str(path),
            'references': sum(len(part.places) for part in parts),
            'bytes': path.stat().st_size,
            'sessions': [
                {
                    'name': part.name,
                    'id': part.session.id,
                    'references': len(part.places),
                    'of': str(part.path),
                }
                for part in parts
            ],
        }
        for path, parts in made
    ]
    if as_json:
        print(json.dumps(facts))
        return 0
    for (path, parts), one in zip(made, facts, strict=True):
        size_mb = path.stat().st_size / 1e6
        print(f'{path}: {one["references"]} references, {size_mb:.1f} MB, {len(parts)} sessions')
        for number, part in enumerate(parts):
            print(f'  {number} {printable(part.name)}: {len(part.places)} of {part.path}')
    return 0
