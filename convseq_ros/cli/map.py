# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Edit map files: `convseq map VERB`."""

import argparse
from dataclasses import replace
from functools import partial
import json
from pathlib import Path
import re

from convseq_ros.cli import map_link
from convseq_ros.cli.info import describe_map, in_short
from convseq_ros.cli.options import add_max_looks, add_verb, refuse_name
from convseq_ros.cli.outputs import add_output
from convseq_ros.core.map.edit import prune_looks, pruned, rename_session, unlink
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.session_slice import (
    chosen_slice,
    joined,
    required_slices,
    SessionSlice,
    slices_of,
)
from convseq_ros.core.map.writer import refuse_existing, rewrite, save_map
from convseq_ros.errors import MapError, NO_PLACES
from convseq_ros.io.output_file import ANY, make_folder

_SESSION = 'name, number or id of a session, as `convseq info` shows it'
_UNUSUAL = re.compile(r'[^\w.-]+')  # in the name of a file


def describe(parser: argparse.ArgumentParser) -> None:
    """Declare the verbs, and their arguments."""
    verbs = parser.add_subparsers(dest='verb', required=True, metavar='VERB')
    add = add_verb(
        verbs, 'link', map_link.run, 'link places that show the same, and solve the poses'
    )
    map_link.describe(add)

    add = add_verb(verbs, 'unlink', _unlink, 'take links out of a map: all, unless some are named')
    add.add_argument('map', type=Path, help='replaced in one step, or not at all')
    add.add_argument(
        '--place', type=int, action='append', default=[], metavar='N', help='whose link is wrong'
    )
    add.add_argument('--session', action='append', default=[], help=_SESSION)

    add = add_verb(verbs, 'merge', _merge, 'put the sessions of several maps into one')
    add.add_argument('maps', type=Path, nargs='+', metavar='MAP', help='not changed')
    add_output(add, '-o', '--output', kinds=ANY, required=True, help='map file to make')
    add.add_argument(
        '--no-links', action='store_true', help='do not recognise the maps in each other: quicker'
    )
    add_max_looks(add, keeps_all=False)

    add = add_verb(verbs, 'split', _split, 'make a map of each session of a map')
    add.add_argument('map', type=Path, help='not changed')
    add.add_argument(
        '-o', '--output', type=Path, help='folder of the maps to make; by default that of the map'
    )

    add = add_verb(verbs, 'remove', _remove, 'take sessions or surplus looks out of a map')
    add.add_argument('map', type=Path, help='replaced in one step, or not at all')
    selection = add.add_mutually_exclusive_group(required=True)
    selection.add_argument('--session', action='append', help=_SESSION)
    add_max_looks(selection)
    add.set_defaults(max_looks=None)  # a value that is the default counts as not given

    add = add_verb(verbs, 'rename', _rename, 'call a session of a map by another name')
    add.add_argument('map', type=Path)
    add.add_argument('--session', required=True, help=_SESSION)
    add.add_argument('name', help='new name')

    for name in ('merge', 'split', 'remove', 'rename'):
        verbs.choices[name].add_argument('--json', action='store_true', help='print as JSON')


def run(chosen: argparse.Namespace) -> int:
    """Run the verb."""
    chosen.act(chosen)
    return 0


def _unlink(chosen: argparse.Namespace) -> None:
    reference_map = open_map(chosen.map)
    linked = {place for place, _ in reference_map.links}
    if unknown := {*chosen.place} - linked:
        raise MapError(f'{chosen.map}: place {min(unknown)} has no link; name one that has')
    places = {*chosen.place}
    for wanted in chosen.session:
        places |= {*chosen_slice(required_slices(chosen.map, reference_map), wanted).places}
    count = unlink(chosen.map, places or None)
    note = 'their places are not looked up again'
    if not places:
        note = 'convseq map link looks them up anew'
    print(f'{chosen.map}: {count} of {len(linked)} links taken out; {note}')


def _merge(chosen: argparse.Namespace) -> None:
    refuse_existing(chosen.output)
    slices = [session for path in chosen.maps for session in slices_of(path)]
    if not slices:
        raise MapError(f'{chosen.maps[0]}: {NO_PLACES}')
    merged = joined(slices)
    if not chosen.no_links:
        map_link.link(chosen.output, merged)
    merged = pruned(chosen.output, merged, chosen.max_looks)
    save_map(merged, chosen.output, is_new=True)
    _report(chosen, chosen.output)


def _split(chosen: argparse.Namespace) -> None:
    folder, files = chosen.output or chosen.map.parent, dict[Path, SessionSlice]()
    for part in required_slices(chosen.map):
        name = _UNUSUAL.sub('_', part.session.name).strip('._') or str(part.number)
        path = folder / f'{name}.db'
        if path in files or path.exists():
            path = folder / f'{name}-{part.number}.db'
        refuse_existing(path)
        files[path] = part
    make_folder(folder)
    for path, part in files.items():
        save_map(joined([part]), path, is_new=True)
    _report(chosen, *files)


def _remove(chosen: argparse.Namespace) -> None:
    if chosen.session:
        rewrite(chosen.map, partial(_without_sessions, chosen))
    else:
        prune_looks(chosen.map, chosen.max_looks)
    _report(chosen, chosen.map)


def _without_sessions(chosen: argparse.Namespace, opened: ReferenceMap) -> ReferenceMap:
    slices = required_slices(chosen.map, opened)
    removed = [chosen_slice(slices, wanted) for wanted in chosen.session]
    if remaining := [part for part in slices if part not in removed]:
        return joined(remaining)
    raise MapError(f'{chosen.map}: nothing would be left of it; delete the file instead')


def _rename(chosen: argparse.Namespace) -> None:
    slices = required_slices(chosen.map)
    part, name = chosen_slice(slices, chosen.session), chosen.name
    refuse_name(name)
    if any(other.session.name == name for other in slices if other is not part):
        raise MapError(f'{chosen.map}: another session is called {name!r}; take another name')
    rename_session(replace(part, session=replace(part.session, name=name)))
    _report(chosen, chosen.map)


def _report(chosen: argparse.Namespace, *paths: Path) -> None:
    """Print what the maps hold now."""
    facts = [describe_map(path, open_map(path)) for path in paths]
    if chosen.json:
        print(json.dumps(facts))
        return
    for fact in facts:
        print(f'{fact["map"]}: {in_short(fact)}')
