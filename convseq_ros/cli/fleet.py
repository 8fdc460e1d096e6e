# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Many maps on many processes or machines: `convseq fleet build` and so on."""

import argparse
from dataclasses import replace
from functools import lru_cache
import json
from pathlib import Path
from threading import Event
from uuid import uuid4

from convseq_ros.cli import fleet_build
from convseq_ros.cli.fleet_build import add_cluster, chosen_cluster
from convseq_ros.cli.map_link import add_outputs, make_outputs
from convseq_ros.cli.options import chosen_config
from convseq_ros.cli.replay import add_replay, in_words, replay_chosen, warn
from convseq_ros.cli.terminal import progress
from convseq_ros.core.graph.links import Link
from convseq_ros.core.linking import link_map, not_linked
from convseq_ros.core.map.edit import joined, SessionSlice, slices_of
from convseq_ros.core.session import warm_up
from convseq_ros.errors import ConvseqError, MapError
from convseq_ros.fleet.cluster import connected, done
from convseq_ros.fleet.link import serve
from convseq_ros.fleet.session import FleetSession
from convseq_ros.onnx_model import open_model
from convseq_ros.sources.folder import natural_key

COMMANDS = {
    'build': 'build a map of each recording in a folder, in parallel',
    'link': 'recognise each session of the maps in a folder in the others',
    'replay': 'recognise the frames of a recording in all maps of a folder',
    'serve': 'have robots ask all maps of a folder',
}


def describe(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of each command."""
    commands = parser.add_subparsers(dest='work', required=True, metavar='|'.join(COMMANDS))
    for name, text in COMMANDS.items():
        own = commands.add_parser(name, help=text, description=text.capitalize() + '.')
        describe_one, do = VERBS[name]
        describe_one(own)
        own.set_defaults(do=do)


def run(chosen: argparse.Namespace) -> int:
    """Run the one that was chosen."""
    return int(chosen.do(chosen))


def _describe_serve(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument('maps', type=Path, help='folder of maps, which answer as one would')
    add_cluster(parser)


def _serve(chosen: argparse.Namespace) -> int:
    """Tell a scheduler its maps; without one, be it until Ctrl-C."""
    paths = maps_in(chosen.maps)
    with connected(chosen_cluster(chosen)) as client:
        serve(client, paths)
        address = client.scheduler.address
        print(f'{address}: {len(paths)} maps; vpr_node --ros-args -p fleet:={address}', flush=True)
        if not chosen.scheduler:
            Event().wait()
    return 0


def _describe_replay(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument('maps', type=Path, help='folder of maps, which answer as one would')
    parser.add_argument('recording', type=Path, help='recording or folder of images')
    add_cluster(parser)
    add_replay(parser)


def _replay(chosen: argparse.Namespace) -> int:
    """Replay, write the table, and sum it up."""
    paths, told = maps_in(chosen.maps), set[str]()
    # Without a scheduler, workers are of this process: messages are not pickled, and cost half.
    with connected(replace(chosen_cluster(chosen), are_threads=True)) as client:
        sources, config = chosen.topic.split(), chosen_config(chosen)
        model = open_model(config)
        session = FleetSession(client, paths, config, sources=sources, describe=model)

        def tell() -> None:
            for line in session.missing:
                if line not in told:
                    warn(f'{line}; the other maps answer')
            told.update(session.missing)

        tell()
        for one in session.cameras.each:
            warm_up(one)
        summary = replay_chosen(chosen, session.cameras, chosen.maps, tell)
    fleet = session.fleet
    if chosen.json:
        about = {'output': str(chosen.output), 'slow': session.slow, 'missing': session.missing}
        print(json.dumps(about | summary))
    else:
        lost = f', {len(session.missing)} of {len(paths)} maps missing' if session.missing else ''
        print(f'{chosen.maps}: {fleet.count} places of {len(fleet.offsets)} maps{lost}')
        print(f'{chosen.output}: {in_words(summary, session.slow)}')
    return 0


def maps_in(folder: Path) -> list[Path]:
    """Return the maps in a folder, map2 before map10; MapError if there are none."""
    found = sorted((one for one in folder.glob('*.db') if one.is_file()), key=natural_key)
    if not found:
        raise MapError(f'{folder}: no map in it (*.db); make some with convseq fleet build')
    return found


def _describe_link(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        'map', type=Path, metavar='MAPS', help='folder of maps; none of them is changed'
    )
    add_cluster(parser)
    add_outputs(parser)


def _link(chosen: argparse.Namespace) -> int:
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


VERBS = {
    'build': (fleet_build.describe, fleet_build.run),
    'link': (_describe_link, _link),
    'replay': (_describe_replay, _replay),
    'serve': (_describe_serve, _serve),
}
