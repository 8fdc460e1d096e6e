# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Link the places of a fleet's maps that show the same: `convseq fleet link MAPS`."""

import argparse
from functools import lru_cache
from pathlib import Path
from uuid import uuid4

from convseq_ros.cli.fleet_options import add_cluster, chosen_cluster
from convseq_ros.cli.fleet_replay import maps_in
from convseq_ros.cli.map_link import add_outputs, make_outputs
from convseq_ros.cli.progress import progress
from convseq_ros.cli.replay import warn
from convseq_ros.core.graph.links import Link
from convseq_ros.core.linking import link_map, not_linked
from convseq_ros.core.map.edit import joined, SessionSlice, slices_of
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
    """
    Link all maps as if merged, a session a job; print what was found, and make what is asked for.

    Sessions are looked up at the same time: none knows what another one was linked to meanwhile.
    """
    paths, slices = list[Path](), list[SessionSlice]()
    for path in maps_in(chosen.map):
        try:
            slices += slices_of(path)
            paths.append(path.resolve())
        except MapError as error:
            warn(f'{error}; the other maps are linked')
    if not slices:
        raise MapError(f'{chosen.map}: no map of it has a place')
    whole, once = joined(slices), (tuple(paths), uuid4().hex)
    jobs = {f'{one.start}': (*once, one) for one in not_linked(whole)}
    links = list[Link]()
    with connected(chosen_cluster(chosen)) as client:
        found = done(client, links_in, jobs)
        for _, those in progress(found, len(jobs), chosen.map.name, 'sessions'):
            if isinstance(those, ConvseqError):
                raise those
            links += those
    for one in sorted(links, key=lambda one: one.place):
        whole.links.add(one.place, one.other, one.confidence, one.inliers, one.relative)
    make_outputs(chosen, whole)
    return 0


def links_in(paths: tuple[Path, ...], run: str, session: range) -> list[Link]:
    """Return the links of a session of some maps to what comes before, in one run."""
    whole = joined(_slices(paths, run))
    for _ in link_map(whole, sessions=[session]):
        pass
    return [one for one in whole.links.each() if one.place in session]


@lru_cache(maxsize=1)
def _slices(paths: tuple[Path, ...], _run: str) -> list[SessionSlice]:
    return [one for path in paths for one in slices_of(path)]
