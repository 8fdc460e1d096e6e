# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Make a map of each session of a map: `convseq map split MAP`."""

import argparse
from pathlib import Path
import re

from convseq_ros.cli.sessions import add_json, report, watched
from convseq_ros.core.map.editing import Part, parts_of, write_parts
from convseq_ros.errors import MapError

_UNUSUAL = re.compile(r'[^\w.-]+')


def describe(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument('map', type=Path, help='not changed')
    parser.add_argument(
        '-o', '--output', type=Path, help='folder of the maps to make; by default that of the map'
    )
    add_json(parser)


def run(chosen: argparse.Namespace) -> int:
    """Split, and say what was made; nothing is made if one of the files is there already."""
    folder = chosen.output or chosen.map.parent
    files: dict[Path, list[Part]] = {}
    for part in parts_of(chosen.map):
        name = _UNUSUAL.sub('_', part.name).strip('._') or str(part.number)
        path = folder / f'{name}.db'
        if path in files or path.exists():
            path = folder / f'{name}-{part.number}.db'
        files[path] = [part]
    for path in files:
        if path.exists():
            raise MapError(f'{path}: exists already; name another folder with -o')
    folder.mkdir(parents=True, exist_ok=True)
    for path, parts in files.items():
        write_parts(parts, path, watched(path))
    return report(list(files.items()), chosen.json)
