# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A map as a picture: its drives as lines, sessions in colours, and its links as arcs."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.session_slice import slices_of
from convseq_ros.core.types import constants, Doubles
from convseq_ros.errors import MapError, printable
from convseq_ros.evaluation.plots import new_figure, save
from convseq_ros.pose_graph.edges import Poses
import numpy as np
import numpy.typing as npt

Points = Mapping[int, npt.NDArray[np.float64]]  # (2,), by the index of a place


@constants
class PICTURE:
    """Engineering, not studied."""

    bent: float = 0.2  # offset of an arc's middle, relative to its chord
    flattest: float = 0.4  # smallest ratio of the sides; that of a straight street would be 0
    named: int = 12  # maximum number of sessions in the legend


def draw_map(path: Path, reference_map: ReferenceMap, name: Path) -> None:
    """Draw a map of this name by its poses; MapError if it has none."""
    poses = {at: place.pose for at, place in enumerate(reference_map.places) if place.pose}
    if not poses:
        raise MapError(f'{name}: the map has no poses to draw it by; build it with --odom')
    points = {at: np.array(pose.position[:2]) for at, pose in poses.items()}
    draw_drives((figure := new_figure(8, 6)).add_subplot(), reference_map, points)
    save(figure, path)


def draw_solved(path: Path, reference_map: ReferenceMap, before: Poses, after: Poses) -> None:
    """Draw a map by its poses before and after they were solved, side by side."""
    figure = new_figure(12, 5)
    both = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, title, poses in zip(both, ('before', 'after'), (before, after), strict=True):
        draw_drives(axes, reference_map, {at: pose[:2, 3] for at, pose in poses.items()})
        axes.set_title(title)
    figure.tight_layout()
    save(figure, path)


def draw_drives(axes: Any, reference_map: ReferenceMap, points: Points) -> None:
    """Draw the drives and links of a map whose places lie at `points`."""
    ends = ((link.other, link.place) for link in reference_map.links.each())
    draw_arcs(axes, ((points[a], points[b]) for a, b in ends if {a, b} <= points.keys()), '0.6')
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


def draw_arcs(axes: Any, ends: Iterable[tuple[Doubles, Doubles]], color: str) -> None:
    """Draw an arc from each start (2,) to its end (2,)."""
    from matplotlib.collections import PathCollection
    from matplotlib.path import Path as Curve

    curves = []
    for start, end in ends:
        x, y = end - start
        aside = (start + end) / 2 + PICTURE.bent * np.array((-y, x))
        curves.append(Curve([start, aside, end], [Curve.MOVETO, Curve.CURVE3, Curve.CURVE3]))
    axes.add_collection(PathCollection(curves, facecolor='none', edgecolor=color, linewidth=0.5))
