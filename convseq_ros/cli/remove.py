# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Take something out of a map: `convseq map remove MAP --session NAME` or `--max-looks N`."""

import argparse
from pathlib import Path

from convseq_ros.cli.build_map import parsed_looks
from convseq_ros.cli.sessions import add_json, report, SESSION_HELP, watched
from convseq_ros.core.map.bounded import bound
from convseq_ros.core.map.editing import chosen_part, parts_of, write_parts
from convseq_ros.errors import MapError


def describe(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument('map', type=Path, help='replaced in one step, or not at all')
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument('--session', action='append', help=SESSION_HELP)
    what.add_argument(
        '--max-looks',
        metavar='N',
        help='looks of a place that stay; of more, the one most like another goes',
    )
    add_json(parser)


def run(chosen: argparse.Namespace) -> int:
    """Remove, and say what is left."""
    if chosen.max_looks is not None:
        count = parsed_looks(chosen.max_looks)
        bound(chosen.map, count, watched(chosen.map))
        return report([(chosen.map, parts_of(chosen.map))], chosen.json)
    parts = parts_of(chosen.map)
    removed = [chosen_part(parts, said) for said in chosen.session]
    left = [part for part in parts if part not in removed]
    if not left:
        raise MapError(f'{chosen.map}: nothing would be left of it; delete the file instead')
    write_parts(left, chosen.map, watched(chosen.map), replaces=True)
    return report([(chosen.map, left)], chosen.json)
