# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Draw the way of a frame, for docs/ARCHITECTURE.md. Usage: architecture.py FILE.png."""

from pathlib import Path
import sys

from convseq_ros.evaluation.plots import new_figure, save
from matplotlib.axes import Axes
from matplotlib.patches import FancyBboxPatch

INK, DIM, BLUE, FILL, SIDE = '#17212b', '#5b6b7a', '#1f6fb2', '#eaf2fa', '#f4efe4'
WIDTH, STEP = 0.86, 1.0
# Stage, what it does, where.
STAGES = (
    ('frame gate', 'late? still?\nno keyframe?', 'gate/'),
    ('encode', 'cells and\nsalient regions', 'encoding/'),
    ('coarse scores', 'one number for\neach place', 'retrieval/'),
    ('pair scores', 'rough for 40,\nfull for some 15', 'similarity/'),
    ('verify', 'some 10 places,\ndisplacements', 'geometry/'),
    ('decide', 'belief:\npredict, update', 'decision/'),
    ('measure', 'relative pose,\ncovariance', 'pose/'),
)
READS_MAP = (2, 3, 4, 5, 6)


def main(path: Path) -> None:
    """Draw."""
    figure = new_figure(12, 4.2)
    axes = figure.add_axes((0.005, 0.01, 0.99, 0.98))
    axes.set_xlim(-0.05, STEP * len(STAGES) - 0.09)
    axes.set_ylim(0, 4.2)
    axes.set_axis_off()
    end = STEP * (len(STAGES) - 1) + WIDTH
    _box(axes, 0, 3.3, 2.86, 0.8, SIDE)
    _text(axes, 1.43, 3.82, 'in: node (ROS), sources (files), simulation', 11)
    _text(axes, 1.43, 3.52, 'Frame: stamp, gray image, odometry pose', 9.5, DIM)
    _box(axes, end - 2.86, 3.3, 2.86, 0.8, SIDE)
    _text(axes, end - 1.43, 3.82, 'out: Match, as topics, CSV, MCAP', 11)
    _text(axes, end - 1.43, 3.52, 'place, confidence, reason, relative pose', 9.5, DIM)
    for index, (name, what, where) in enumerate(STAGES):
        left, middle = STEP * index, STEP * index + WIDTH / 2
        _box(axes, left, 1.55, WIDTH, 1.3, FILL)
        _text(axes, middle, 2.63, name, 11.5)
        _text(axes, middle, 2.2, what, 9, DIM)
        _text(axes, middle, 1.72, where, 9, BLUE)
        if index:
            _arrow(axes, left - STEP + WIDTH, 2.2, left, 2.2)
        if index in READS_MAP:
            _arrow(axes, middle, 0.9, middle, 1.55)
    _arrow(axes, WIDTH / 2, 3.3, WIDTH / 2, 2.85)
    _arrow(axes, end - WIDTH / 2, 2.85, end - WIDTH / 2, 3.3)
    _arrow(axes, WIDTH / 2, 1.55, WIDTH / 2, 0.9)
    _text(axes, WIDTH / 2 + 0.08, 1.2, 'online: keyframes are added', 9, DIM, 'left')
    _box(axes, 0, 0.1, end, 0.8, SIDE)
    _text(axes, end / 2, 0.62, 'map: one SQLite file (map/, graph/)', 11)
    _text(axes, end / 2, 0.32, 'places with cells, descriptors, poses; sessions; links', 9.5, DIM)
    save(figure, path)


def _box(axes: Axes, x: float, y: float, width: float, height: float, color: str) -> None:
    style = 'round,pad=0,rounding_size=0.06'
    axes.add_patch(
        FancyBboxPatch((x, y), width, height, style, facecolor=color, edgecolor=DIM, linewidth=0.8)
    )


def _text(
    axes: Axes, x: float, y: float, text: str, size: float, color: str = INK, at: str = 'center'
) -> None:
    axes.text(x, y, text, size=size, color=color, ha=at, va='center', linespacing=1.3)


def _arrow(axes: Axes, x: float, y: float, to_x: float, to_y: float) -> None:
    style = {'arrowstyle': '-|>', 'color': BLUE, 'shrinkA': 0, 'shrinkB': 0}
    axes.annotate('', (to_x, to_y), (x, y), arrowprops=style)


if __name__ == '__main__':
    main(Path(sys.argv[1]))
