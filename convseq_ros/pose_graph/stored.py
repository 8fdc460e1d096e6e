# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The pose graph of a map: its drives with odometry, and their closures."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import groupby
from operator import attrgetter

from convseq_ros.config.pose_graph_config import PoseGraphConfig
from convseq_ros.core.graph.trail import Keyframe
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.rigid import composed_covariance, Matrix, matrix
from convseq_ros.core.types import Anchor, RelativePose
from convseq_ros.pose_graph.closures import Closure, told, usable
from convseq_ros.pose_graph.edges import Edge
from convseq_ros.pose_graph.graph import PoseGraph
from convseq_ros.pose_graph.optimisation import position_sigma_m
from convseq_ros.pose_graph.output import linked_drives, whole
import numpy as np

_PAUSE_S = 10**8
_MOST_SOLUTIONS = 10  # of a drive: each may break odometry elsewhere


def graph_of(
    stored: ReferenceMap, config: PoseGraphConfig, with_all_links: bool = False
) -> PoseGraph:
    """
    Return the graph of a map, solved; its newest drive is the running one, and may go on.

    Its closures are those that were told while it was driven, and links that were measured later,
    or all that were measured; none of a place that a person unlinked. A drive with poses but no
    odometry is in no graph: its poses count as they are. ConvseqError if GTSAM is not installed.
    """
    keyframes = stored.trail.since(0)
    driven = {keyframe.session_id for keyframe in keyframes}
    places = {anchor: at for at, anchor in enumerate(_anchors(stored))}
    graph = PoseGraph(config, in_map=any(one.session_id not in driven for one in places))
    is_whole = True
    for session, drive in groupby(keyframes, attrgetter('session_id')):
        graph.pause()
        ends = list[tuple[Keyframe, Anchor, RelativePose | None]]()
        for keyframe in drive:
            graph.add_odometry(keyframe.stamp_ns, matrix(keyframe.pose), keyframe.pose.variances)
            ends += ((keyframe, *end) for end in _ends(keyframe, stored, places, with_all_links))
        graph.name_session(session)
        for keyframe, other, relative in ends:
            pose, covariance = told(relative)
            moved, covariance = matrix(pose), usable(covariance, config.closure_sigma_rad)
            name = '' if other.session_id == session else other.session_id
            graph.add_closure(Closure(keyframe.stamp_ns, other.stamp_ns, moved, covariance, name))
            at = places.get(other)
            if at is not None and other.session_id not in driven and stored.places[at].pose:
                there = matrix(stored.places[at].pose)
                spread = composed_covariance(there, np.zeros((6, 6)), moved, covariance)
                graph.add_pose(keyframe.stamp_ns, there @ moved, spread)
        if problem := graph.problem():
            problem = problem.of_drive() if graph.earlier else problem
            graph.adopt(problem, problem.solve())
        is_whole = _solve_breaks(graph) or not graph.earlier
    if not is_whole and (problem := graph.problem(again=True)):
        graph.adopt(problem, problem.solve())
        _solve_breaks(graph)
    graph.pause()
    graph.without_place = graph.twice = graph.restarts = 0
    return graph


@dataclass(frozen=True, eq=False, slots=True)
class SolvedMap:
    """The graph of a map, as `write_g2o` takes it, and the corrected poses of places."""

    vertices: dict[int, Matrix]  # (4, 4)
    edges: list[Edge]
    stamps_ns: dict[int, int]  # of the vertices
    places: dict[int, Matrix]  # (4, 4), by index, of the drives that closures bring into one frame
    linked: frozenset[int]  # the vertices of these drives

    def position_sigma_m(self) -> float:
        """Return how well the positions of linked drives are known, in metres."""
        poses = {at: pose for at, pose in self.vertices.items() if at in self.linked}
        return position_sigma_m(poses, self.edges)


def solved(stored: ReferenceMap) -> SolvedMap:
    """
    Return a map's graph, solved as `graph_of` does, where all drives are by odometry.

    Where a drive has poses and no trail, the places with poses make the drives, and their links
    the closures. ConvseqError if GTSAM is not installed.
    """
    posed = [at for at in range(len(stored.places)) if stored.places.position(at)]
    ids = [session.id for session in stored.sessions]
    session = {at: ids[stored.places.session(at)] for at in posed}
    stamps_ns = {at: stored.places[at].stamp_ns for at in posed}
    times, config = stamps_ns, PoseGraphConfig()
    if {*session.values()} - {one.session_id for one in stored.trail.since(0)}:
        # Some have no real times: a second from place to place, and a long pause between drives.
        times = {at: (at + (1 + stored.places.session(at)) * _PAUSE_S) * 10**9 for at in posed}
        stored, config = _by_places(stored, session, times), PoseGraphConfig(graph_spacing_m=0.01)
    graph = graph_of(stored, config, with_all_links=True)
    places, linked = dict[int, Matrix](), set[int]()
    for drive in linked_drives(graph):
        linked.update(drive.nodes)
        keyframes = graph.corrected(drive)
        for at in posed:
            if session[at] in drive.sessions and (found := drive.place(times[at])):
                places[at] = keyframes[found[0] - drive.first] @ found[1]
    vertices, edges, vertex_times = whole(graph)
    real = {time: stamps_ns[at] for at, time in times.items()}
    stamps = {vertex: real.get(time, time) for vertex, time in vertex_times.items()}
    return SolvedMap(vertices, edges, stamps, dict(sorted(places.items())), frozenset(linked))


def _by_places(
    stored: ReferenceMap, session: Mapping[int, str], times: Mapping[int, int]
) -> ReferenceMap:
    """Return a map with a trail that places with poses and links with a position make."""
    made = ReferenceMap(sessions=stored.sessions)
    for at, time in times.items():
        link, pose, end = stored.links.details(at), stored.places[at].pose, None
        relative = link.relative if link else None
        assert pose
        if link and relative and relative.pose and link.other in times:
            end = Anchor(session[link.other], times[link.other])
        made.trail.add(Keyframe(session[at], time, pose, end, relative if end else None))
    return made


def _solve_breaks(graph: PoseGraph) -> bool:
    """Solve all drives if closures say that odometry breaks; return whether they do."""
    if not graph.is_breaking:
        return False
    for again in (True, *[False] * _MOST_SOLUTIONS):
        if problem := graph.problem(again):
            graph.adopt(problem, problem.solve())
    return True


def _anchors(stored: ReferenceMap) -> Iterator[Anchor]:
    """Yield the session and the stamp of each place."""
    ids, columns = [session.id for session in stored.sessions], stored.places.columns
    rows = zip(columns['session'].tolist(), columns['stamp_ns'].tolist(), strict=True)
    return (Anchor(ids[session], stamp_ns) for session, stamp_ns in rows)


def _ends(
    keyframe: Keyframe, stored: ReferenceMap, places: dict[Anchor, int], with_all_links: bool
) -> Iterator[tuple[Anchor, RelativePose | None]]:
    """Yield the places that a keyframe closes loops with, and its poses there."""
    at = places.get(Anchor(keyframe.session_id, keyframe.stamp_ns), -1)
    if keyframe.other and not stored.links.is_unlinked(at):
        yield keyframe.other, keyframe.relative
    link = stored.links.details(at)
    if link and link.relative and (with_all_links or not keyframe.is_held_back):
        other = stored.places[link.other]
        yield Anchor(stored.sessions[other.session].id, other.stamp_ns), link.relative
