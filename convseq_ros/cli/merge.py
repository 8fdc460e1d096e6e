# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Put the sessions of several maps into one: `convseq map merge A B... -o C`."""

import argparse
from pathlib import Path

from convseq_ros.cli.build_map import parsed_looks
from convseq_ros.cli.sessions import add_json, report, watched
from convseq_ros.cli.terminal import progress
from convseq_ros.core.linking import link_map, not_linked
from convseq_ros.core.map.bounded import bound
from convseq_ros.core.map.editing import joined, parts_of, write_parts
from convseq_ros.errors import MapError


def describe(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument('maps', type=Path, nargs='+', metavar='MAP', help='not changed')
    parser.add_argument('-o', '--output', type=Path, required=True, help='map file to make')
    parser.add_argument(
        '--no-links', action='store_true', help='do not recognise the maps in each other: quicker'
    )
    parser.add_argument(
        '--max-looks', default='0', metavar='N', help='keep so many looks of a place; 0 keeps all'
    )
    add_json(parser)


def run(chosen: argparse.Namespace) -> int:
    """Merge, and say what was made."""
    looks = parsed_looks(chosen.max_looks)
    parts = [part for path in chosen.maps for part in parts_of(path)]
    made = parts
    if parts and not chosen.no_links:
        if chosen.output.exists():
            raise MapError(f'{chosen.output}: exists already; name another file')
        made = joined(parts)
        whole = made[0].reference_map
        count = sum(map(len, not_linked(whole)))
        for _ in progress(link_map(whole), count, 'links', 'places'):
            pass
    write_parts(made, chosen.output, watched(chosen.output))
    if looks and bound(chosen.output, looks):
        parts = parts_of(chosen.output)
    return report([(chosen.output, parts)], chosen.json)
