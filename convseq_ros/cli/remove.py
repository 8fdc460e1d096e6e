# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Take sessions out of a map: `convseq map remove MAP --session NAME`."""

import argparse
from pathlib import Path

from convseq_ros.cli.sessions import add_json, report, SESSION_HELP, watched
from convseq_ros.core.map.editing import chosen_part, parts_of, write_parts
from convseq_ros.errors import MapError


def describe(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument('map', type=Path, help='replaced in one step, or not at all')
    parser.add_argument('--session', action='append', required=True, help=SESSION_HELP)
    add_json(parser)


def run(chosen: argparse.Namespace) -> int:
    """Remove, and say what is left."""
    parts = parts_of(chosen.map)
    removed = [chosen_part(parts, said) for said in chosen.session]
    left = [part for part in parts if part not in removed]
    if not left:
        raise MapError(f'{chosen.map}: nothing would be left of it; delete the file instead')
    write_parts(left, chosen.map, watched(chosen.map), replaces=True)
    return report([(chosen.map, left)], chosen.json)
