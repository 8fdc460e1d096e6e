# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Link the places of a map that show the same, and solve its poses: `convseq map link MAP`."""

import argparse
from collections import Counter
from contextlib import closing
from dataclasses import replace
import json
from pathlib import Path
import sys

from convseq_ros.cli.build_map import of_links
from convseq_ros.cli.map_picture import draw_drives
from convseq_ros.cli.options import add_parameters, given
from convseq_ros.cli.pose_graph import brought_together, edges_of, g2o, Poses, poses_of, solved
from convseq_ros.cli.sessions import watched
from convseq_ros.cli.terminal import printable, progress
from convseq_ros.config import make_config
from convseq_ros.core.graph.links import Link
from convseq_ros.core.linking import link_map, not_linked
from convseq_ros.core.map.autosave import Autosave
from convseq_ros.core.map.editing import Part, parts_of, write_parts
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.rigid import pose_of
from convseq_ros.errors import MapError
from convseq_ros.evaluation.plots.figure import new_figure, save
from convseq_ros.results import complete_or_absent


def describe(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument('map', type=Path, help='map file; gets the links that it lacks')
    add_outputs(parser)
    add_parameters(parser, 'links', of_links())


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
    """Look up what was not looked up before, keep its links, and make what is asked for."""
    _refuse_existing(chosen)
    config = make_config(given(chosen, of_links()))
    whole = open_map(chosen.map)
    if count := sum(map(len, not_linked(whole))):
        with closing(Autosave(chosen.map, whole.encoding, whole.keyframes, True)) as kept:
            for _ in progress(
                link_map(kept.reference_map, config), count, chosen.map.name, 'places'
            ):
                kept.save()
    make_outputs(chosen, parts_of(chosen.map))
    return 0


def make_outputs(chosen: argparse.Namespace, parts: list[Part]) -> None:
    """Report the links of the sessions of one map, and make of them what is asked for."""
    _refuse_existing(chosen)
    if not parts:
        raise MapError(f'{chosen.map}: has no place')
    whole = parts[0].reference_map
    links = [*whole.links.each()]
    _report(parts, links, chosen.json)
    edges = list(edges_of(whole, links))
    if chosen.g2o:
        with complete_or_absent(chosen.g2o) as file:
            file.write_text(''.join(f'{line}\n' for line in g2o(whole, edges)), encoding='utf-8')
    if chosen.output or chosen.picture:
        start = brought_together(whole, edges)
        if not start:
            raise MapError(
                f'{chosen.map}: no link is measured in metres; that needs a map built with --odom '
                'and --camera-info'
            )
        after = solved(edges, start)
        if chosen.picture:
            _draw(chosen.picture, whole, poses_of(whole), after)
        if chosen.output:
            write_parts(
                [_moved(part, after) for part in parts], chosen.output, watched(chosen.output)
            )


def _refuse_existing(chosen: argparse.Namespace) -> None:
    if chosen.output and chosen.output.exists():
        raise MapError(f'{chosen.output}: exists already; name another file')


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
                'anchor': link.anchor,
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
            f'linked, {measured} measured in metres{": " if where else ""}{where}'
        )


def _draw(path: Path, whole: ReferenceMap, before: Poses, after: Poses) -> None:
    figure = new_figure(10, 4)
    for number, (title, poses) in enumerate((('before', before), ('after', after)), 1):
        axes = figure.add_subplot(1, 2, number)
        points = {at: pose[:2, 3] for at, pose in poses.items()}
        draw_drives(axes, whole, points, whole.links.each())
        axes.set_title(title)
        axes.set_xlabel('x, m')
        axes.set_ylabel('y, m')
    save(figure, path)
    print(f'{path}: drawn', file=sys.stderr)
