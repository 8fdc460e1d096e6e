# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Draw the pictures of docs/MATCHING.md from two drives along a drawn street.

Usage: explained.py FOLDER, which gets explained_*.png.
"""

from dataclasses import replace
from pathlib import Path
import sys

from convseq_ros.app.map_builder import build_map
from convseq_ros.config import Config, with_values
from convseq_ros.core.compiled import kernels_of
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.similarity.matcher import make_matcher
from convseq_ros.core.types import Frame
from convseq_ros.evaluation.plots import new_figure, save
from convseq_ros.simulation.drive import draw, Drive, Shot
from convseq_ros.simulation.street import Street
import cv2
import numpy as np

FRAMES, SHOWN, WRONG = 60, 30, 12
SIDE = 512
GREEN, RED, INK = '#178a3d', '#c62828', '#17212b'
SETTINGS = {'keyframe_overlap': 1.0, 'stationary_glance': 0.0, 'search': 'exhaustive'}


def main(folder: Path) -> None:
    """Drive twice, and draw."""
    config = with_values(Config(), SETTINGS)
    street = Street(length_m=FRAMES + 60, seed=7)
    day = Drive(num_frames=FRAMES, width_px=320, height_px=240)
    evening, night = (
        replace(day, seed=5, lane_offset_m=-0.2 - aside_m, light=light)
        for light, aside_m in (('evening', 0.0), ('night', 2.0))
    )
    first, second, third = (
        [_frame(shot) for shot in draw(street, drive)] for drive in (day, evening, night)
    )
    _draw_image(folder / 'explained_image.png', second[SHOWN])
    _draw_sequence(folder / 'explained_sequence.png', first, third, config)
    _draw_fields(folder / 'explained_field.png', first, second, config)


def _frame(shot: Shot) -> Frame:
    return Frame(shot.stamp_ns, cv2.cvtColor(shot.image, cv2.COLOR_BGR2GRAY))


def _square(frame: Frame) -> np.ndarray:
    return cv2.resize(frame.gray, (SIDE, SIDE))


def _draw_image(path: Path, frame: Frame) -> None:
    """Draw an image, the direction of what is in its cells, and its salient regions."""
    assert frame.gray is not None
    described = describe(frame.gray)
    cells, count = described.cells, described.cells.shape[0]
    figure = new_figure(12, 4.3)
    axes = figure.subplots(1, 3)
    titles = ('the image', 'cells: how much edge, and its direction', 'salient regions')
    for each, title in zip(axes, titles, strict=True):
        each.set_title(title, color=INK, size=12)
        each.set_axis_off()
    axes[0].imshow(_square(frame), 'gray')
    axes[1].imshow(np.full((SIDE, SIDE), 255), 'gray', vmin=0, vmax=255)
    strength = cells.sum(axis=2)
    strength = strength / np.percentile(strength, 98)
    # Bins of the gradient's direction, over half a turn; edges lie across.
    angle = (cells.argmax(axis=2) + 0.5) * np.pi / cells.shape[2] + np.pi / 2
    size = SIDE / count
    for row in range(count):
        for column in range(count):
            half = np.array([np.cos(angle[row, column]), np.sin(angle[row, column])]) * size / 2
            x, y = (column + 0.5) * size, (row + 0.5) * size
            axes[1].plot(
                [x - half[0], x + half[0]],
                [y - half[1], y + half[1]],
                color=INK,
                linewidth=1.4,
                alpha=float(min(1.0, strength[row, column])),
            )
    side = count - 1
    salient = described.salient.reshape(side, side).astype(np.uint8)
    mask = cv2.resize(salient, (SIDE, SIDE), interpolation=cv2.INTER_NEAREST)
    axes[2].imshow(_square(frame), 'gray', alpha=0.35)
    axes[2].imshow(np.where(mask, _square(frame), np.nan), 'gray', vmin=0, vmax=255)
    figure.tight_layout()
    save(figure, path)


def _draw_fields(path: Path, first: list[Frame], second: list[Frame], config: Config) -> None:
    """Draw where regions went: alike at the right place, anywhere at a wrong one."""
    known = build_map(first, None, config)
    matcher = make_matcher(known, config)
    for frame in second[: SHOWN + 1]:
        assert frame.gray is not None
        features = matcher.extract(describe(frame.gray))
    assert features and features.packed
    kernels = kernels_of('convseq_ros.core.geometry')
    verified = matcher.verified(features, [SHOWN, WRONG])
    figure = new_figure(12, 4.5)
    axes = figure.subplots(1, 2)
    cell = SIDE / (features.packed.side + 2)
    for each, index, name in zip(axes, (SHOWN, WRONG), ('the right', 'another'), strict=True):
        shift = matcher.shift(features, index)
        assert shift
        start = round(shift[0]), round(shift[1])
        reference = matcher.packed(index)
        found = kernels.displacements(features.packed, reference, start)
        _, off = kernels.fit_motion(found, features.packed.side, start)
        each.imshow(_square(second[SHOWN]), 'gray', alpha=0.55)
        alike = off <= 2
        for chosen, colour in ((~alike, RED), (alike, GREEN)):
            rows, columns, down, across = found[chosen, :4].T
            each.quiver(
                (columns + 1.5) * cell,
                (rows + 1.5) * cell,
                across * cell,
                down * cell,
                color=colour,
                angles='xy',
                scale_units='xy',
                scale=1,
                width=0.003,
            )
        told = verified[index]
        each.set_title(
            f'{name} place: {told.inliers} inliers, verification score {told.strength:.0f}',
            color=INK,
            size=12,
        )
        each.set_axis_off()
    figure.tight_layout()
    save(figure, path)


def _draw_sequence(path: Path, first: list[Frame], second: list[Frame], config: Config) -> None:
    """Draw pair scores, and the diagonal that a drive makes of them."""
    recognizer = PlaceRecognizer(build_map(first, None, config), config)
    scores = np.full((len(second), len(first)), np.nan)
    matches = []
    for number, frame in enumerate(second):
        match = recognizer.process(frame)
        if recognizer.features:  # of all places, also those that were not asked for
            request = recognizer.features, np.arange(len(first))
            (scores[number],) = recognizer.matcher.scores_of([request])
        if match.accepted:
            matches.append((number, match.accepted.reference_index))
    figure = new_figure(12, 4.6)
    axes = figure.subplots(1, 2, width_ratios=(1, 1.25))
    axes[0].imshow(scores, 'Blues', aspect='equal', interpolation='nearest')
    axes[0].plot([m[1] for m in matches], [m[0] for m in matches], '.', color=GREEN, markersize=4)
    axes[0].set(xlabel='place of the map', ylabel='frame of a drive at night')
    axes[0].set_title('pair scores; green: accepted', color=INK, size=12)
    one, ten = scores[SHOWN], _diagonals(scores, SHOWN, 10)
    axes[1].plot(one, color='#9db4c8', label='the newest frame alone')
    axes[1].plot(ten, color='#0b62b0', label='ten frames along diagonals')
    axes[1].axvline(SHOWN, color=GREEN, linestyle=':', label='the right place')
    axes[1].set(xlabel='place of the map', ylabel='score')
    axes[1].set_title(f'frame {SHOWN}: the right place stands out', color=INK, size=12)
    axes[1].legend(frameon=False)
    figure.tight_layout()
    save(figure, path)


def _diagonals(scores: np.ndarray, row: int, length: int) -> np.ndarray:
    """Return the mean of scores along each diagonal that ends at a row."""
    found = np.full(scores.shape[1], np.nan)
    for end in range(length - 1, scores.shape[1]):
        steps = np.arange(length)
        found[end] = scores[row - steps, end - steps].mean()
    return found


if __name__ == '__main__':
    main(Path(sys.argv[1]))
