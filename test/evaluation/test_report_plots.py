# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figures for papers, slides and the README: they are written whole and show what they should."""

import sys
import warnings
import xml.etree.ElementTree

from convseq_ros.errors import ConvseqError
from convseq_ros.evaluation import plots
import cv2
import numpy as np
import pytest

SCORES = np.random.default_rng(5).random((30, 40)).astype(np.float32)
TRUTH = np.arange(30)
GREEN = (128, 222, 74)  # plots.RIGHT as BGR
RED = (107, 107, 255)


def shows(image: np.ndarray, color: tuple[int, int, int]) -> bool:
    return bool((abs(image.astype(int) - color).max(axis=2) < 3).any())


def pair(right: bool, shape: tuple[int, ...] = (90, 160)) -> tuple:
    return np.full(shape, 99, np.uint8), np.full(shape, 99, np.uint8), 'query 5 | map 6', right


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


def test_every_figure_is_a_png_and_an_svg_without_a_date(tmp_path):
    def draw(folder):
        folder.mkdir()

        def files(name):
            return [folder / f'{name}.png', folder / f'{name}.svg']

        right = abs(np.subtract.outer(TRUTH, np.arange(40))) <= 2
        plots.draw_curves(files('curves'), 'set', {'a': ([0.1, 0.5], [1, 0.8]), 'b': ([], [])})
        plots.draw_accuracies(files('bars'), 'set', [('a', 0.9, 0.8, 1.0), ('b', 0.1, None, None)])
        plots.draw_matrix(files('matrix'), 'a', SCORES, right, TRUTH, TRUTH < 20)
        plots.draw_lengths(files('lengths'), 'a', [2, 3], [0.4, np.nan], 0.5)
        return sorted(folder.iterdir())

    for path in draw(tmp_path / 'one'):
        if path.suffix == '.svg':
            assert xml.etree.ElementTree.parse(path).getroot().tag.endswith('svg')
            assert 'dc:date' not in path.read_text()
        else:
            assert cv2.imread(str(path)).std() > 1
    assert len(list((tmp_path / 'one').iterdir())) == 8


def test_without_matplotlib_a_figure_gives_advice(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, 'matplotlib.figure', None)
    with pytest.raises(ConvseqError, match='pip install matplotlib'):
        plots.draw_lengths([tmp_path / 'a.png'], 'a', [1], [0.5], None)


def test_many_methods_find_room(tmp_path):
    names = [f'a-method-of-some-length-{index}' for index in range(45)]
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        plots.draw_curves([tmp_path / 'a.png'], 'set', dict.fromkeys(names, ([0.5, 1], [1, 0.5])))
        plots.draw_accuracies([tmp_path / 'b.png'], 'set', [(one, 0.5, 0.4, 0.6) for one in names])
        table = [{'said': 0.5, 'right': 0.5, 'count': 9}]
        plots.draw_reliability([tmp_path / 'c.png'], 'set', dict.fromkeys(names, table))
    assert len(list(tmp_path.iterdir())) == 3
