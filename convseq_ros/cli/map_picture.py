# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A map as a picture: its drives as lines, sessions in colours, and its links as arcs."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from convseq_ros.core.map.edit import slices_of
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import constants
from convseq_ros.errors import printable
from convseq_ros.evaluation.plots import new_figure, save
from convseq_ros.pose_graph.edges import Poses
import numpy as np
import numpy.typing as npt

Points = Mapping[int, npt.NDArray[np.float64]]  # (2,), by the index of a place


@constants
class PICTURE:
    """Engineering, not studied."""

    bent: float = 0.2  # offset of an arc's middle, relative to its chord
    linked: float = 0.01  # length of a link in a layout, in steps of a drive
    landmarks: int = 300  # places of a component whose distances place the others
    flattest: float = 0.4  # smallest ratio of the sides; that of a straight street would be 0
    named: int = 12  # maximum number of sessions in the legend


def draw_map(path: Path, reference_map: ReferenceMap) -> str:
    """Draw a map by its poses, or laid out by its links if it has none; return which."""
    axes = (figure := new_figure(8, 6)).add_subplot()
    poses = {at: place.pose for at, place in enumerate(reference_map.places) if place.pose}
    points = {at: np.array(pose.position[:2]) for at, pose in poses.items()}
    if points:
        _draw_drives(axes, reference_map, points)
    else:
        _draw_drives(axes, reference_map, laid_out(reference_map))
        axes.set_axis_off()
    save(figure, path)
    return 'along its poses' if points else 'laid out by its links'


def draw_solved(path: Path, reference_map: ReferenceMap, before: Poses, after: Poses) -> None:
    """Draw a map by its poses before and after they were solved, side by side."""
    figure = new_figure(12, 5)
    both = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, title, poses in zip(both, ('before', 'after'), (before, after), strict=True):
        _draw_drives(axes, reference_map, {at: pose[:2, 3] for at, pose in poses.items()})
        axes.set_title(title)
    figure.tight_layout()
    save(figure, path)


def _draw_drives(axes: Any, reference_map: ReferenceMap, points: Points) -> None:
    """Draw the drives and links of a map whose places lie at `points`."""
    from matplotlib.collections import PathCollection
    from matplotlib.path import Path as Curve

    curves = []
    for link in reference_map.links.each():
        if link.place in points and link.other in points:
            start, end = points[link.other], points[link.place]
            x, y = end - start
            aside = (start + end) / 2 + PICTURE.bent * np.array((-y, x))
            curves.append(Curve([start, aside, end], [Curve.MOVETO, Curve.CURVE3, Curve.CURVE3]))
    arcs = PathCollection(curves, facecolor='none', edgecolor='0.6', linewidth=0.5)
    axes.add_collection(arcs)
    for part in (slices := slices_of(Path('session'), reference_map)):
        line = [points[at] for at in part.places if at in points]
        if line:
            name = printable(part.session.name)
            axes.plot(*np.transpose(line), linewidth=1.2, marker='.', markersize=2, label=name)
    widths = [high - low for low, high in (axes.get_xlim(), axes.get_ylim())]
    for (low, high), change in (
        (axes.get_xlim(), axes.set_xlim),
        (axes.get_ylim(), axes.set_ylim),
    ):
        half = max(high - low, PICTURE.flattest * max(widths)) / 2
        change((low + high) / 2 - half, (low + high) / 2 + half)
    axes.set_aspect('equal')
    axes.set_xlabel('x, m')
    axes.set_ylabel('y, m')
    if 1 < len(slices) <= PICTURE.named:
        axes.legend(fontsize='small')


def laid_out(reference_map: ReferenceMap) -> Points:
    """Return points by multidimensional scaling with landmarks (de Silva and Tenenbaum 2004)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components, dijkstra

    count = len(reference_map)
    session = np.array([place.session for place in reference_map.places])
    along = np.flatnonzero(session[:-1] == session[1:])
    pairs = [(link.other, link.place) for link in reference_map.links.each()]
    across = np.array(pairs, np.int64).reshape(-1, 2)
    rows, cols = np.r_[along, across[:, 0]], np.r_[along + 1, across[:, 1]]
    steps = np.r_[np.ones(len(along)), np.full(len(across), PICTURE.linked)]
    graph = coo_array((steps, (rows, cols)), (count, count)).tocsr()
    number, component = connected_components(graph, directed=False)
    points, right = np.zeros((count, 2)), 0.0
    for label in range(number):
        nodes = np.flatnonzero(component == label)
        picked = np.linspace(0, len(nodes) - 1, min(len(nodes), PICTURE.landmarks)).astype(int)
        squares = dijkstra(graph, directed=False, indices=nodes[picked])[:, nodes] ** 2
        placed = _scaled(squares, picked)
        low, high = placed.min(axis=0), placed.max(axis=0)
        points[nodes] = placed + np.array((right - low[0], -(low[1] + high[1]) / 2))
        right += high[0] - low[0] + 0.1 * count**0.5 + 1
    return dict(enumerate(points))


def _scaled(
    squares: npt.NDArray[np.float64], marks: npt.NDArray[np.int64]
) -> npt.NDArray[np.float64]:
    """Return points (n, 2) from the squared distances (m, n) of m of them, the landmarks."""
    between = squares[:, marks]
    middle = between.mean(axis=0)
    centred = -0.5 * (between - middle - middle[:, None] + between.mean())
    values, vectors = np.linalg.eigh(centred)
    axes = vectors[:, -2:] / np.sqrt(np.maximum(values[-2:], 1e-9))
    axes = np.hstack([np.zeros((len(axes), 2 - axes.shape[1])), axes])
    return np.asarray(-0.5 * (squares - middle[:, None]).T @ axes)
