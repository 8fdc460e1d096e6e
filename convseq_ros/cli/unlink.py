# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Take links out of a map: `convseq map unlink MAP --place 120`."""

import argparse
from pathlib import Path

from convseq_ros.cli.sessions import SESSION_HELP
from convseq_ros.core.map.editing import chosen_part, parts_of, unlink
from convseq_ros.errors import MapError


def describe(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument('map', type=Path, help='changed in one step, or not at all')
    parser.add_argument(
        '--place', type=int, action='append', default=[], metavar='N', help='whose link is wrong'
    )
    parser.add_argument('--session', action='append', default=[], help=SESSION_HELP)


def run(chosen: argparse.Namespace) -> int:
    """Unlink, and say how many links went."""
    parts = parts_of(chosen.map)
    places = {*chosen.place}
    for said in chosen.session:
        places |= {*chosen_part(parts, said).places}
    linked = {place for place, _ in parts[0].reference_map.links} if parts else set[int]()
    if unknown := {*chosen.place} - linked:
        raise MapError(f'{chosen.map}: place {min(unknown)} has no link')
    count = unlink(chosen.map, places or None)
    rest = 'are not looked up again' if places else 'convseq map link looks them up anew'
    print(f'{chosen.map}: {count} of {len(linked)} links taken out; {rest}')
    return 0
