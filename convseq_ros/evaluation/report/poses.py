# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Measured relative poses: in words, and on a map of the places."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math

from convseq_ros.core.rigid import angle, Matrix, matrix
from convseq_ros.core.types import Pose
from convseq_ros.evaluation.report.chart import Chart, COLORS
from convseq_ros.evaluation.report.verdict import number, Seen
from convseq_ros.evaluation.run_folder import Run
import numpy as np

WIDTH, LEAST_HEIGHT, MOST_HEIGHT = 980.0, 200.0, 600.0
LEVEL = 0.2  # of its length, from which a way is drawn to scale


@dataclass(frozen=True, slots=True)
class Placed:
    """A query by its measured pose, in the frame of the map's poses."""

    seen: Seen
    pose: Matrix  # (4, 4)
    truth: Matrix | None  # (4, 4), if it is known


def in_words(row: Mapping[str, str]) -> str:
    """Return what a row of the table says of the query's base in its place's; empty if nothing."""
    turn = _orientation(row)
    if turn is None:
        return ''
    x, y, z, w = turn
    yaw_deg = math.degrees(math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
    sigma_deg = math.degrees(number(row.get('heading_sigma_rad')) or 0.0)
    side = 'left' if yaw_deg >= 0 else 'right'
    turned = f'turned {abs(yaw_deg):.1f}° {side} (± {sigma_deg:.1f}°)'
    position = _position(row)
    if position is None:
        return turned
    names = (('ahead', 'behind'), ('left', 'right'), ('up', 'down'))
    ways = ', '.join(
        f'{abs(one):.2f} m {words[one < 0]}' for one, words in zip(position, names, strict=True)
    )
    sigma_m = number(row.get('position_sigma_m')) or 0.0
    return f'{ways} (± {sigma_m:.2f} m), {turned}'


def placed(run: Run, rows: Sequence[Seen]) -> list[Placed]:
    """Return the accepted matches of a run whose pose in the map is known."""
    reference, query = run.poses('reference'), run.poses('query')
    found: list[Placed] = []
    if reference is None or query is None:
        return found
    for seen, row in zip(rows, run.frames, strict=True):
        position, turn = _position(row), _orientation(row)
        if seen.best is None or position is None or turn is None:
            continue
        if (place := _matrix(reference[seen.best])) is not None:
            moved = place @ matrix(Pose(position, turn))
            found.append(Placed(seen, moved, _matrix(query[seen.query])))
    return found


def off_in_words(found: Sequence[Placed]) -> str:
    """Return how far off the truth measured poses are."""
    off = [
        (
            math.dist(one.pose[:3, 3], one.truth[:3, 3]),
            angle(one.pose[:3, :3].T @ one.truth[:3, :3]),
        )
        for one in found
        if one.truth is not None
    ]
    if not off:
        return f'{len(found)} poses'
    metres, radians = np.median(off, axis=0)
    return (
        f'{len(found)} poses, {metres:.2f} m and {math.degrees(radians):.2f}° off the truth in the'
        ' median'
    )


def poses_chart(run: Run, rows: Sequence[Seen]) -> Chart | None:
    """Return a map of places, and of queries where they were measured; None if none was."""
    if not (found := placed(run, rows)):
        return None
    reference = run.poses('reference')
    assert reference is not None
    spans = np.nanmax(reference[:, :2], axis=0) - np.nanmin(reference[:, :2], axis=0)
    is_level = min(spans) > LEVEL * max(spans)
    height = min(max(WIDTH * spans[1] / max(spans[0], 1e-9), LEAST_HEIGHT), MOST_HEIGHT)
    label = f'Places of the map of {run.set}, and {off_in_words(found)} by {run.method}'
    chart = Chart(WIDTH + 64, height + 72, label, f'{run.set}: {run.method}')
    axes = chart.plane((50, 28, WIDTH, height), 'y, m', 'x, m')
    if is_level:
        axes.set_aspect('equal', adjustable='datalim')
    axes.plot(*reference[:, :2].T, '.-', color=COLORS['skipped'], markersize=4, linewidth=1)
    for one in found:
        if one.truth is not None:
            ends = np.array([one.pose[:2, 3], one.truth[:2, 3]])
            axes.plot(*ends.T, color=COLORS['soft'], linewidth=1)
    for verdict in ('right', 'wrong'):
        these = np.array([one.pose[:2, 3] for one in found if one.seen.verdict == verdict])
        if len(these):
            axes.plot(*these.T, 'o', color=COLORS[verdict], markersize=4, label=verdict)
    chart.add_legend(axes)
    return chart


def _position(row: Mapping[str, str]) -> tuple[float, float, float] | None:
    x, y, z = (number(row.get(f'relative_{axis}_m')) for axis in 'xyz')
    return None if x is None or y is None or z is None else (x, y, z)


def _orientation(row: Mapping[str, str]) -> tuple[float, float, float, float] | None:
    x, y, z, w = (number(row.get(f'relative_q{axis}')) for axis in 'xyzw')
    return None if x is None or y is None or z is None or w is None else (x, y, z, w)


def _matrix(numbers: Matrix) -> Matrix | None:
    x, y, z, *turn = numbers.tolist()
    qx, qy, qz, qw = turn
    return matrix(Pose((x, y, z), (qx, qy, qz, qw))) if np.isfinite(numbers).all() else None
