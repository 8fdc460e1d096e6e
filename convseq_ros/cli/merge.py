# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Put the sessions of several maps into one: `convseq merge A B... -o C`."""

import argparse
from pathlib import Path

from convseq_ros.cli.sessions import add_json, report, watched
from convseq_ros.core.map.editing import parts_of, write_parts


def describe(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument('maps', type=Path, nargs='+', metavar='MAP', help='not changed')
    parser.add_argument('-o', '--output', type=Path, required=True, help='map file to make')
    add_json(parser)


def run(chosen: argparse.Namespace) -> int:
    """Merge, and say what was made."""
    parts = [part for path in chosen.maps for part in parts_of(path)]
    write_parts(parts, chosen.output, watched(chosen.output))
    return report([(chosen.output, parts)], chosen.json)
