# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Call a session of a map by another name: `convseq map rename MAP --session NAME NEW`."""

import argparse
from dataclasses import replace
from pathlib import Path

from convseq_ros.cli.sessions import add_json, report, SESSION_HELP
from convseq_ros.core.map.editing import chosen_part, parts_of, rename_session
from convseq_ros.errors import MapError

_MOST_CHARACTERS = 200


def describe(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument('map', type=Path)
    parser.add_argument('--session', required=True, help=SESSION_HELP)
    parser.add_argument('name', help='new name')
    add_json(parser)


def run(chosen: argparse.Namespace) -> int:
    """Rename, and say what the map holds."""
    parts = parts_of(chosen.map)
    part, name = chosen_part(parts, chosen.session), chosen.name
    if not name.isprintable() or not 0 < len(name) <= _MOST_CHARACTERS:
        raise MapError(f'name: {name!a} is no line of 1 to {_MOST_CHARACTERS} characters')
    if any(other.name == name for other in parts if other is not part):
        raise MapError(f'{chosen.map}: another session is called {name!r}; take another name')
    renamed = replace(part, session=replace(part.session, name=name))
    rename_session(renamed)
    shown = [renamed if other is part else other for other in parts]
    return report([(chosen.map, shown)], chosen.json)
