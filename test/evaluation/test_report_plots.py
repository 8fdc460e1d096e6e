# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The demo's picture, and the matrix of scores that it shares with the report."""

import sys

from convseq_ros.errors import ConvseqError
from convseq_ros.evaluation import plots
from convseq_ros.evaluation.plots import reduced, show_matches, show_scores
import cv2
import numpy as np
import pytest

SCORES = np.random.default_rng(5).random((30, 40)).astype(np.float32)
TRUTH = np.arange(30)
GREEN = (128, 222, 74)  # BGR
RED = (107, 107, 255)


def shows(image: np.ndarray, color: tuple[int, int, int]) -> bool:
    return bool((abs(image.astype(int) - color).max(axis=2) < 3).any())


def pair(right: bool, shape: tuple[int, ...] = (90, 160)) -> tuple:
    return np.full(shape, 99, np.uint8), np.full(shape, 99, np.uint8), 'query 5', 'map 6', right


@pytest.fixture(autouse=True)
def drawing():
    pytest.importorskip('matplotlib')


@pytest.mark.parametrize(
    ('pairs', 'found', 'colors'),
    [
        ([pair(True), pair(True)], TRUTH, {GREEN}),
        ([pair(False, (90, 160, 3))], np.full(30, -1), {RED}),
        ([pair(True)] * 9, (TRUTH + 9) % 30, {GREEN, RED}),
        ([], np.full(30, -1), set()),
    ],
)
def test_demo_picture_has_a_frame_for_each_verdict(tmp_path, pairs, found, colors):
    path = tmp_path / 'picture.png'
    plots.demo_picture(path, pairs, SCORES, TRUTH, found, 'A title')
    image = cv2.imread(str(path))
    assert image.shape == (900, 1600, 3)
    assert {color for color in (GREEN, RED) if shows(image, color)} == colors
    assert [one.name for one in tmp_path.iterdir()] == ['picture.png']


def test_demo_picture_bears_unknown_scores_and_a_long_title(tmp_path):
    scores, truth = np.full((30, 40), np.nan, np.float32), np.full(30, -1)
    plots.demo_picture(tmp_path / 'a.png', [pair(True)], scores, truth, truth, 'word ' * 60)
    assert cv2.imread(str(tmp_path / 'a.png')).shape == (900, 1600, 3)


def test_a_matrix_is_bright_where_scores_are_high_and_gray_where_there_are_none(tmp_path):
    scores = np.linspace(0, 1, 16, dtype=np.float32).reshape(4, 4)
    scores[3, 0] = np.nan
    figure = plots.new_figure(4, 4)
    axes = figure.add_axes((0, 0, 1, 1))
    show_scores(axes, scores)
    show_matches(axes, np.array([[0, 3]]), np.array(['wrong']), size=20)
    plots.save(figure, tmp_path / 'a.png')
    image = cv2.imread(str(tmp_path / 'a.png')).astype(int)
    cells = image[50::100, 50::100]
    assert cells[3, 3].sum() > cells[1, 1].sum() > cells[0, 0].sum()
    assert len(set(cells[3, 0])) == 1
    assert abs(cells[0, 3] - RED).max() < 3


def test_a_large_matrix_is_reduced_and_keeps_its_thin_path():
    scores = np.zeros((1000, 700), np.float32)
    scores[500, 333] = 1
    small = reduced(scores)
    assert max(small.shape) <= 320 and small.max() == 1


def test_without_matplotlib_a_figure_gives_advice(monkeypatch):
    monkeypatch.setitem(sys.modules, 'matplotlib.figure', None)
    with pytest.raises(ConvseqError, match='pip install matplotlib'):
        plots.new_figure(1, 1)
