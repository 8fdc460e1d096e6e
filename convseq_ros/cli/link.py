# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recognise each session of a map in the others: `convseq map link MAP`."""

import argparse
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import replace
import json
from pathlib import Path
import sys

from convseq_ros.cli.pose_graph import brought_together, edges_of, g2o, Poses, poses_of, solved
from convseq_ros.cli.printable import printable
from convseq_ros.cli.progress import progress
from convseq_ros.cli.sessions import watched
from convseq_ros.core.graph.links import Link
from convseq_ros.core.linking import links_of
from convseq_ros.core.map.editing import Part, parts_of, write_parts
from convseq_ros.core.rigid import pose_of
from convseq_ros.errors import MapError
from convseq_ros.evaluation.plots.figure import new_figure, save
from convseq_ros.results import complete_or_absent


def describe(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument('map', type=Path, help='map of several sessions; not changed')
    add_outputs(parser)


def add_outputs(parser: argparse.ArgumentParser) -> None:
    """Declare what may be made of links."""
    parser.add_argument('--g2o', type=Path, metavar='FILE', help='write the graph of poses')
    parser.add_argument(
        '-o', '--output', type=Path, metavar='MAP', help='write a map whose poses are in one frame'
    )
    parser.add_argument(
        '--picture', type=Path, metavar='FILE', help='draw the drives before and after'
    )
    parser.add_argument('--json', action='store_true', help='print the links as JSON')


def run(chosen: argparse.Namespace) -> int:
    """Link, and say what was found."""
    parts = parts_of(chosen.map)
    link(chosen, parts, lambda: (one for part in parts for one in _links(part)))
    return 0


def link(
    chosen: argparse.Namespace, parts: list[Part], find: Callable[[], Iterable[Link]]
) -> None:
    """Find the links of the sessions of one map; report them, and make what is asked for."""
    if len(parts) < 2:
        raise MapError(f'{chosen.map}: has one session; put others beside it with convseq merge')
    if chosen.output and chosen.output.exists():
        raise MapError(f'{chosen.output}: exists already; name another file')
    links = sorted(find(), key=lambda one: one.place)
    _report(parts, links, chosen.json)
    whole = parts[0].reference_map
    edges = list(edges_of(whole, links))
    if chosen.g2o:
        with complete_or_absent(chosen.g2o) as file:
            file.write_text(''.join(f'{line}\n' for line in g2o(whole, edges)), encoding='utf-8')
    if chosen.output or chosen.picture:
        start = brought_together(whole, edges)
        if not start:
            raise MapError(f'{chosen.map}: no link is measured in metres; it needs poses, cameras')
        after = solved(edges, start)
        if chosen.picture:
            _draw(chosen.picture, parts, links, poses_of(whole), after)
        if chosen.output:
            write_parts(
                [_moved(part, after) for part in parts], chosen.output, watched(chosen.output)
            )


def _links(part: Part) -> list[Link]:
    found = progress(
        links_of(part.reference_map, part.number), len(part.places), part.name, 'places'
    )
    return [link for link in found if link]


def _moved(part: Part, after: Poses) -> Part:
    """Return a session with its new poses, in the frame of all that are linked."""
    whole = part.reference_map
    if not any(at in after for at in part.places):
        return part
    first = whole.sessions[whole.places[min(after)].session]
    poses = {at: pose_of(after[at]) for at in part.places if at in after}
    frame = first.frame or f'linked {whole.map_id}'
    return replace(part, session=replace(part.session, frame=frame), poses=poses)


def _report(parts: list[Part], links: list[Link], as_json: bool) -> None:
    session = {at: part for part in parts for at in part.places}
    if as_json:
        told = [
            {
                'place': link.place,
                'session': session[link.place].number,
                'other': link.other,
                'other_session': session[link.other].number,
                'confidence': link.confidence,
                'inliers': link.inliers,
                'position_m': link.relative.position_m if link.relative else None,
                'orientation': link.relative.orientation if link.relative else None,
            }
            for link in links
        ]
        print(json.dumps(told))
        return
    for part in parts:
        own = [link for link in links if session[link.place] is part]
        into = Counter(printable(session[link.other].name) for link in own)
        measured = sum(
            link.relative is not None and link.relative.pose is not None for link in own
        )
        where = ', '.join(f'{count} in {name}' for name, count in into.most_common())
        print(
            f'{part.number} {printable(part.name)}: {len(own)} of {len(part.places)} places '
            f'recognised, {measured} measured in metres{": " if where else ""}{where}'
        )


def _draw(path: Path, parts: list[Part], links: list[Link], before: Poses, after: Poses) -> None:
    figure = new_figure(10, 5)
    for number, (title, poses) in enumerate((('before', before), ('after', after)), 1):
        axes = figure.add_subplot(1, 2, number)
        axes.set_title(title)
        axes.set_aspect('equal', 'datalim')
        for link in links:
            if link.place in poses and link.other in poses:
                ends = [poses[at][:2, 3] for at in (link.place, link.other)]
                axes.plot(*zip(*ends, strict=True), color='0.8', linewidth=0.5)
        for part in parts:
            way = [poses[at][:2, 3] for at in part.places if at in poses]
            if way:
                axes.plot(*zip(*way, strict=True), linewidth=1, label=printable(part.name))
        axes.set_xlabel('x, m')
        axes.set_ylabel('y, m')
    axes.legend(fontsize='small')
    save(figure, path)
    print(f'{path}: drawn', file=sys.stderr)
