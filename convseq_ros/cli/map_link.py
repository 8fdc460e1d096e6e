# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Link the places of a map that show the same, and solve its poses: `convseq map link MAP`."""

import argparse
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
import json
from pathlib import Path
import sys

from convseq_ros.app.map_builder import link_map, not_linked
from convseq_ros.cli.map_picture import draw_solved
from convseq_ros.cli.options import progress
from convseq_ros.cli.outputs import add_output
from convseq_ros.core.graph.links import Link
from convseq_ros.core.map.edit import forget_links
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.session_slice import joined, required_slices, SessionSlice
from convseq_ros.core.map.writer import refuse_existing, rewrite, save_map
from convseq_ros.core.rigid import matrix, pose_of
from convseq_ros.errors import MapError, printable
from convseq_ros.io.output_file import ANY, FIGURE, OutputFile
from convseq_ros.io.regular_file import write_lines
from convseq_ros.pose_graph.edges import Poses
from convseq_ros.pose_graph.lines import beside, tum, write_g2o
from convseq_ros.pose_graph.stored import solved


def describe(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument('map', type=Path, help='map file; gets the links that it lacks')
    help_ = 'replace all links by new ones, but for those that `unlink` took out'
    parser.add_argument('--again', action='store_true', help=help_)
    add = parser.add_argument
    help_ = 'write the solved graph of poses, and FILE.csv with the times of its vertices'
    add_output(parser, '--g2o', metavar='FILE', help=help_)
    help_ = 'write a map whose poses are in one frame'
    add_output(parser, '-o', '--output', kinds=ANY, metavar='MAP', help=help_)
    help_ = 'draw the drives before and after'
    add_output(parser, '--picture', kinds=FIGURE, metavar='FILE', help=help_)
    help_ = 'write the trajectory in one frame, in the format of TUM, as evo reads'
    add_output(parser, '--tum', metavar='FILE', help=help_)
    add('--json', action='store_true', help='print the links as JSON')


def run(chosen: argparse.Namespace) -> None:
    """Link the places that are not linked yet, or all, store the links, and make the outputs."""
    if chosen.output:
        refuse_existing(chosen.output)
    if chosen.g2o:
        OutputFile('--g2o', beside(chosen.g2o)).refuse(filter(None, (chosen.map, chosen.tum)))
    if chosen.again or not_linked(open_map(chosen.map)):
        rewrite(chosen.map, partial(_linked, chosen))
    _make_outputs(chosen, open_map(chosen.map))


def _linked(chosen: argparse.Namespace, opened: ReferenceMap) -> ReferenceMap:
    """Return a map with the links that it lacks, or with new ones."""
    if chosen.again:
        forget_links(opened)
    link(chosen.map, opened)
    return opened


def link(path: Path, unlinked: ReferenceMap) -> None:
    """Link the places of a map that are not linked yet, with progress."""
    count = sum(map(len, not_linked(unlinked)))
    for _ in progress(link_map(unlinked), count, path.name, 'places'):
        pass


def _make_outputs(chosen: argparse.Namespace, linked: ReferenceMap) -> None:
    """Print the links of a map, and make the outputs that the options name."""
    slices, links = required_slices(chosen.map, linked), [*linked.links.each()]
    _report(slices, links, chosen.json)
    if not (chosen.g2o or chosen.output or chosen.picture or chosen.tum):
        return
    graph = solved(linked)
    if chosen.g2o:
        write_g2o(chosen.g2o, graph.vertices, graph.edges, graph.stamps_ns)
    if not (chosen.output or chosen.picture or chosen.tum):
        return
    if not links:
        raise MapError(
            f'{chosen.map}: no place was passed twice, so there is no link; add another drive: '
            'convseq build-map RECORDING MAP --append'
        )
    if not (after := graph.places):
        raise MapError(
            f'{chosen.map}: no link is measured in metres; that needs a map built with --odom '
            'and --camera-info'
        )
    if chosen.tum:
        stamped = ((linked.places[at].stamp_ns, pose_of(pose)) for at, pose in after.items())
        write_lines(chosen.tum, tum(stamped))
    if chosen.picture:
        before = {at: matrix(place.pose) for at, place in enumerate(linked.places) if place.pose}
        draw_solved(chosen.picture, linked, before, after)
        print(f'{chosen.picture}: drawn', file=sys.stderr)
    if chosen.output:
        first = linked.sessions[linked.places.session(min(after))]
        frame = first.frame or f'linked {linked.map_id}'
        moved = [_moved(part, after, frame) for part in slices]
        made = joined(moved)
        made.position_sigma_m = graph.position_sigma_m()
        save_map(made, chosen.output, is_new=True)
        known = f'its poses are known to {made.position_sigma_m:.2f} m, as the map tells'
        print(f'{chosen.output}: {known}', file=sys.stderr)


def _moved(part: SessionSlice, after: Poses, name: str) -> SessionSlice:
    """Return a session with its new poses, in the frame `name` of all linked sessions."""
    poses = {at: pose_of(after[at]) for at in part.places if at in after}
    return replace(part, session=replace(part.session, frame=name), poses=poses) if poses else part


def _report(slices: Sequence[SessionSlice], links: Sequence[Link], as_json: bool) -> None:
    session = {at: part for part in slices for at in part.places}
    if as_json:
        facts = [
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
                'covariance': link.relative.covariance.tolist() if link.relative else None,
            }
            for link in links
        ]
        print(json.dumps(facts))
        return
    for part in slices:
        of_part = [link for link in links if session[link.place] is part]
        into = Counter(printable(session[link.other].session.name) for link in of_part)
        measured = sum(bool(link.relative and link.relative.pose) for link in of_part)
        where = ', '.join(f'{count} in {name}' for name, count in into.most_common())
        print(
            f'{part.number} {printable(part.session.name)}: {len(of_part)} of {len(part.places)} '
            f'places linked, {measured} measured in metres{": " if where else ""}{where}'
        )
