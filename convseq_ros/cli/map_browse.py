# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A page of a map's links, each with its pair of pictures: `convseq map browse MAP`."""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from convseq_ros.cli.options import note, progress, quoted_path, say
from convseq_ros.cli.outputs import add_output
from convseq_ros.cli.replay_report import place_text, session_lines
from convseq_ros.config import Config
from convseq_ros.core.graph.links import Link
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.rigid import matrix
from convseq_ros.core.similarity.matcher import make_matcher
from convseq_ros.errors import ConvseqError, MapError, printable
from convseq_ros.evaluation.report.above import Arc, drawn_above
from convseq_ros.evaluation.report.matches import MatchPage, Texts
from convseq_ros.evaluation.report.pairs import Pair, pair_of_places
from convseq_ros.io.output_file import PAGE
from convseq_ros.pose_graph.alignment import align_sessions
from convseq_ros.pose_graph.edges import edges_of
from convseq_ros.pose_graph.optimisation import optimise

_LINKED, _DENIED = 'linked', 'denied by the poses'
_COLORS = {_DENIED: '#e03131', _LINKED: '#2f9e44'}


def describe(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument('map', type=Path, help='not changed')
    help_ = 'page to write; default: %(default)s'
    add_output(parser, '-o', '--output', kinds=PAGE, default=Path('links.html'), help=help_)


def run(chosen: argparse.Namespace) -> None:
    """Write the page, and print how to take a wrong link out."""
    whole = open_map(chosen.map)
    if not (links := [*whole.links.each()]):
        raise MapError(f'{chosen.map}: has no link; `convseq map link` looks for some')
    denied = denied_places(whole, links)
    unlink = f'convseq map unlink {quoted_path(str(chosen.map))}'
    config = replace(Config(), encoding=whole.encoding)
    matcher = make_matcher(whole, config) if whole.encoding.keeps_cells else None
    page, arcs = MatchPage(len(links), _LINKED, _COLORS), list[Arc]()
    points = whole.places.columns['pose'][:, :2]  # NaN where unknown
    for link in progress(links, len(links), chosen.map.name, 'links'):
        kind = _DENIED if link.place in denied else _LINKED
        arcs.append((len(arcs), _COLORS[kind], points[[link.place, link.other]]))

        def make(link: Link = link) -> tuple[Texts, Pair]:
            pair = pair_of_places(whole, link.place, link.other, matcher, page.width_px)
            return _texts(whole, link, unlink), pair

        page.add(kind, link.confidence, link.place, make)
    facts = [f'{len(links)} links', *([f'{len(denied)} denied by the poses'] if denied else [])]
    page.write(
        chosen.output,
        f'Links of {printable(chosen.map.name)}',
        facts,
        drawn_above(session_lines(whole), arcs),
        {'map': printable(str(chosen.map)), 'map id': whole.map_id, 'keyframes': len(whole)},
        'Height: confidence. Below: the place. The pairs that agree least come first.',
        order=lambda position: (links[position].inliers or 0, position),
    )
    say(f'{chosen.output}: {", ".join(facts)}')
    wrong = ''.join(f' --place {place}' for place in sorted(denied)) or ' --place N'
    say(f'to take out {"these" if denied else "the N of the page that is wrong"}: {unlink}{wrong}')


def denied_places(reference_map: ReferenceMap, links: Sequence[Link]) -> set[int]:
    """Return the places whose links a robust solution of the poses leaves out, if it is known."""
    poses = {at: matrix(place.pose) for at, place in enumerate(reference_map.places) if place.pose}
    session = [place.session for place in reference_map.places]
    edges = [*edges_of(poses, session, links)]
    start = align_sessions(poses, session, edges)
    if not start:
        return set()
    try:
        kept = optimise(edges, start).kept
    except ConvseqError as error:  # GTSAM is not installed
        note(f'which links the poses deny is not known: {error}')
        return set()
    used = [edge.end for edge in edges if edge.is_link and {edge.start, edge.end} <= start.keys()]
    return {place for place, is_kept in zip(used, kept, strict=True) if not is_kept}


def _texts(whole: ReferenceMap, link: Link, unlink: str) -> Texts:
    """Return the texts about a link and its places."""
    figures = [] if link.confidence is None else [f'confidence {link.confidence:.3f}']
    figures += [] if link.inliers is None else [f'{link.inliers} regions agree']
    if link.relative and (moved := link.relative.position_m):
        figures.append(f'the first is {moved[0]:.2f} m ahead, {moved[1]:.2f} m left')
    return (
        f'Place {link.place} is linked to place {link.other}\n'
        f'If that is wrong: {unlink} --place {link.place}',
        f'{place_text(whole, link.place)}\n{printable(whole.places[link.place].source)}',
        f'{place_text(whole, link.other)}\n{", ".join(figures)}',
    )
