# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Leave out what other sessions of a map know as well: `convseq thin MAP`."""

import argparse
from dataclasses import replace
from pathlib import Path

from convseq_ros.cli.printable import printable
from convseq_ros.cli.sessions import add_json, report, SESSION_HELP, watched
from convseq_ros.core.linking import selected
from convseq_ros.core.map.editing import chosen_part, Part, parts_of, runs_of, write_parts
from convseq_ros.core.map.limits import within_limits
from convseq_ros.core.thinning import Needed, needed
from convseq_ros.errors import MapError
from convseq_ros.online_config import OnlineConfig


def describe(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument('map', type=Path, help='replaced in one step, or not at all')
    parser.add_argument(
        '--session', action='append', help=f'{SESSION_HELP}; by default all, the newest first'
    )
    for name, what in (('places-per-m', 'places a metre'), ('map-mb', 'megabytes')):
        parser.add_argument(
            f'--max-{name}',
            type=float,
            metavar='N',
            help=f'of more {what} leave out the looks that were no answer for longest, instead: '
            f'what mode: lifelong does by max_{name.replace("-", "_")} when it opens a map',
        )
    parser.add_argument('--dry-run', action='store_true', help='say what would be left, and why')
    add_json(parser)


def run(chosen: argparse.Namespace) -> int:
    """Thin, and say what is left, and why."""
    parts = parts_of(chosen.map)
    limits = {
        name: value
        for name in ('max_places_per_m', 'max_map_mb')
        if (value := getattr(chosen, name)) is not None
    }
    if limits:
        if chosen.session or chosen.dry_run:
            raise MapError(
                f'{chosen.map}: limits hold for all of it; leave out --session and --dry-run'
            )
        parts, _ = within_limits(parts, OnlineConfig(**limits), watched(chosen.map))
        return report([(chosen.map, parts)], chosen.json)
    asked = [chosen_part(parts, said) for said in chosen.session or ()] or parts[::-1]
    left: dict[int, list[Part]] = {part.number: [part] for part in parts}
    for part in asked:
        found = _needed(part, [one for own in left.values() for one in own])
        left[part.number] = runs_of(part, found.runs)
        if not chosen.json:
            print(_reason(part, found))
    kept = [one for part in parts for one in left[part.number]]
    if not chosen.dry_run and kept != parts:
        if not kept:
            raise MapError(f'{chosen.map}: nothing would be left of it')
        write_parts(kept, chosen.map, watched(chosen.map), replaces=True)
    return report([(chosen.map, kept)], chosen.json)


def _needed(part: Part, left: list[Part]) -> Needed:
    """Return what of a session is needed beside what is left of the others, by own indices."""
    whole = part.reference_map
    indices = sorted({at for one in left for at in one.places} | set(part.places))
    found = needed(selected(whole, indices), part.number)
    runs = tuple(range(indices[run.start], indices[run.stop - 1] + 1) for run in found.runs)
    return replace(found, runs=runs)


def _reason(part: Part, found: Needed) -> str:
    kept = sum(map(len, found.runs))
    return (
        f'{printable(part.name)}: {kept} of {len(part.places)} places are needed; elsewhere '
        f'{found.known} are known, {found.unknown} are not'
    )
