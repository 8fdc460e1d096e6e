# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recognise each session of a fleet's maps in the others: `convseq fleet link MAPS`."""

import argparse
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from uuid import uuid4

from convseq_ros.cli.fleet_options import add_cluster, chosen_cluster
from convseq_ros.cli.fleet_replay import maps_in
from convseq_ros.cli.link import add_outputs, link
from convseq_ros.cli.progress import progress
from convseq_ros.cli.replay import warn
from convseq_ros.core.graph.links import Link
from convseq_ros.core.linking import links_of
from convseq_ros.core.map.editing import joined, Part, parts_of
from convseq_ros.errors import ConvseqError, MapError
from convseq_ros.fleet.cluster import connected
from convseq_ros.fleet.jobs import done


def describe(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        'map', type=Path, metavar='MAPS', help='folder of maps; none of them is changed'
    )
    add_cluster(parser)
    add_outputs(parser)


def run(chosen: argparse.Namespace) -> int:
    """Link as `convseq link` does in all maps merged with no links added, a session a job."""
    paths, parts = list[Path](), list[Part]()
    for path in maps_in(chosen.map):
        try:
            parts += parts_of(path)
            paths.append(path.resolve())
        except MapError as error:
            warn(f'{error}; the other maps are linked')
    if not parts:
        raise MapError(f'{chosen.map}: no map of it has a place')
    parts = joined(parts)
    once = tuple(paths), uuid4().hex
    jobs = {str(number): (*once, number) for number in range(len(parts))}

    def find() -> Iterator[Link]:
        with connected(chosen_cluster(chosen)) as client:
            found = done(client, links_in, jobs)
            for _, links in progress(found, len(jobs), chosen.map.name, 'sessions'):
                if isinstance(links, ConvseqError):
                    raise links
                yield from links

    link(chosen, parts, find)
    return 0


def links_in(paths: tuple[Path, ...], run: str, number: int) -> list[Link]:
    """Return the links of a session of some maps to the others, in one run of the command."""
    return [one for one in links_of(_whole(paths, run)[number].reference_map, number) if one]


@lru_cache(maxsize=1)
def _whole(paths: tuple[Path, ...], _run: str) -> list[Part]:
    return joined([part for path in paths for part in parts_of(path)])
