# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What becomes of map files: `convseq map VERB`."""

import argparse
from dataclasses import replace
import json
from pathlib import Path
import re

from convseq_ros.cli import map_link
from convseq_ros.cli.info import describe_map, in_short
from convseq_ros.cli.options import add_max_looks, add_verb, of_map, progress
from convseq_ros.core.map.edit import (
    chosen_slice,
    joined,
    prune_looks,
    pruned,
    refuse_existing,
    rename_session,
    SessionSlice,
    slices_of,
    unlink,
    write_new,
)
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map_builder import link_map, not_linked
from convseq_ros.errors import MapError

_SESSION = 'name, number or id of a session, as `convseq info` shows it'
_UNUSUAL = re.compile(r'[^\w.-]+')  # in the name of a file
_MOST_CHARACTERS = 200  # of a session's name


def describe(parser: argparse.ArgumentParser) -> None:
    """Declare the verbs, and their arguments."""
    verbs = parser.add_subparsers(dest='verb', required=True, metavar='VERB')
    add = add_verb(
        verbs, 'link', map_link.run, 'link places that show the same, and solve the poses'
    )
    map_link.describe(add)

    add = add_verb(verbs, 'unlink', _unlink, 'take links out of a map')
    add.add_argument('map', type=Path, help='changed in one step, or not at all')
    add.add_argument(
        '--place', type=int, action='append', default=[], metavar='N', help='whose link is wrong'
    )
    add.add_argument('--session', action='append', default=[], help=_SESSION)

    add = add_verb(verbs, 'merge', _merge, 'put the sessions of several maps into one')
    add.add_argument('maps', type=Path, nargs='+', metavar='MAP', help='not changed')
    add.add_argument('-o', '--output', type=Path, required=True, help='map file to make')
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
    what = add.add_mutually_exclusive_group(required=True)
    what.add_argument('--session', action='append', help=_SESSION)
    add_max_looks(what)

    add = add_verb(verbs, 'rename', _rename, 'call a session of a map by another name')
    add.add_argument('map', type=Path)
    add.add_argument('--session', required=True, help=_SESSION)
    add.add_argument('name', help='new name')

    for name in ('merge', 'split', 'remove', 'rename'):
        verbs.choices[name].add_argument('--json', action='store_true', help='print as JSON')


def run(chosen: argparse.Namespace) -> int:
    """Do what the verb says."""
    chosen.act(chosen)
    return 0


def _unlink(chosen: argparse.Namespace) -> None:
    whole = open_map(chosen.map)
    linked = {place for place, _ in whole.links}
    if unknown := {*chosen.place} - linked:
        raise MapError(f'{chosen.map}: place {min(unknown)} has no link')
    places = {*chosen.place}
    for wanted in chosen.session:
        places |= {*chosen_slice(slices_of(chosen.map, whole), wanted).places}
    count = unlink(chosen.map, places or None)
    rest = 'their places are not looked up again'
    if not places:
        rest = 'convseq map link looks them up anew'
    print(f'{chosen.map}: {count} of {len(linked)} links taken out; {rest}')


def _merge(chosen: argparse.Namespace) -> None:
    refuse_existing(chosen.output)
    slices = [one for path in chosen.maps for one in slices_of(path)]
    if not slices:
        raise MapError(f'{chosen.maps[0]}: has no place')
    whole = joined(slices)
    if not chosen.no_links:
        count = sum(map(len, not_linked(whole)))
        for _ in progress(link_map(whole), count, 'links', 'places'):
            pass
    whole = pruned(chosen.output, whole, chosen.max_looks)
    write_new(whole, chosen.output, of_map(chosen.output))
    _report(chosen, chosen.output)


def _split(chosen: argparse.Namespace) -> None:
    folder, files = chosen.output or chosen.map.parent, dict[Path, SessionSlice]()
    for one in slices_of(chosen.map):
        name = _UNUSUAL.sub('_', one.session.name).strip('._') or str(one.number)
        path = folder / f'{name}.db'
        if path in files or path.exists():
            path = folder / f'{name}-{one.number}.db'
        refuse_existing(path)
        files[path] = one
    folder.mkdir(parents=True, exist_ok=True)
    for path, one in files.items():
        write_new(joined([one]), path, of_map(path))
    _report(chosen, *files)


def _remove(chosen: argparse.Namespace) -> None:
    if chosen.session:
        slices = slices_of(chosen.map)
        removed = [chosen_slice(slices, wanted) for wanted in chosen.session]
        left = [one for one in slices if one not in removed]
        if not left:
            raise MapError(f'{chosen.map}: nothing would be left of it; delete the file instead')
        write_new(joined(left), chosen.map, of_map(chosen.map), slices[0].reference_map)
    else:
        prune_looks(chosen.map, chosen.max_looks, of_map(chosen.map))
    _report(chosen, chosen.map)


def _rename(chosen: argparse.Namespace) -> None:
    slices = slices_of(chosen.map)
    one, name = chosen_slice(slices, chosen.session), chosen.name
    if not name.isprintable() or not 0 < len(name) <= _MOST_CHARACTERS:
        raise MapError(f'name: {name!a} is no line of 1 to {_MOST_CHARACTERS} characters')
    if any(other.session.name == name for other in slices if other is not one):
        raise MapError(f'{chosen.map}: another session is called {name!r}; take another name')
    rename_session(replace(one, session=replace(one.session, name=name)))
    _report(chosen, chosen.map)


def _report(chosen: argparse.Namespace, *paths: Path) -> None:
    """Print what maps hold now."""
    facts = [describe_map(path, open_map(path)) for path in paths]
    if chosen.json:
        print(json.dumps(facts))
        return
    for one in facts:
        print(f'{one["map"]}: {in_short(one)}')
