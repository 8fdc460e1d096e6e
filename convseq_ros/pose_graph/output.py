# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a pose graph gives to others: the corrected path, all of it, and drives in one frame."""

from bisect import bisect_right
from itertools import pairwise
import math

from convseq_ros.core.rigid import Matrix
from convseq_ros.pose_graph.edges import Edge
from convseq_ros.pose_graph.graph import PoseGraph
from convseq_ros.pose_graph.odometry import Odometry


def trajectory(graph: PoseGraph, most: int | None = None) -> list[tuple[int, Matrix]]:
    """
    Return the stamps and the corrected poses (4, 4) of the running drive's keyframes.

    Of more than `most` it is every n-th, and the newest.
    """
    count = len(graph.running.keyframes)
    step = max(1, math.ceil(count / (most or count or 1)))
    nodes = graph.running.nodes[::-step][::-1]
    stamps = [graph.running.keyframe_ns(node) for node in nodes]
    return [*zip(stamps, graph.corrected(graph.running, nodes), strict=True)]


def whole(graph: PoseGraph) -> tuple[dict[int, Matrix], list[Edge], dict[int, int]]:
    """Return the corrected keyframes of all drives by node, all edges, and stamps by node."""
    poses, edges, stamps_ns = dict[int, Matrix](), list[Edge](), dict[int, int]()
    for drive in graph.drives:
        poses |= zip(drive.nodes, graph.corrected(drive), strict=True)
        edges += [drive.edge(*both) for both in pairwise(drive.nodes)]
        stamps_ns |= {node: drive.keyframe_ns(node) for node in drive.nodes}
    kept = (one.edge for one in graph.known.values() if one.edge and one.kept)
    edges += (edge for edge in kept if edge.start in poses)
    return poses, edges, stamps_ns


def linked_drives(graph: PoseGraph) -> list[Odometry]:
    """Return the drives that closures bring into one frame, that of the first that has any."""
    drives = graph.drives
    firsts = [drive.first for drive in drives]
    kept = [one.edge for one in graph.known.values() if one.edge and one.kept]
    pairs = [[bisect_right(firsts, end) - 1 for end in edge.ends] for edge in kept]
    found = {min(map(min, pairs))} if pairs else set[int]()
    while more := [pair for pair in pairs if found & {*pair} and not found >= {*pair}]:
        found.update(*more)
    return [drives[number] for number in sorted(found)]
