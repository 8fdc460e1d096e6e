# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Charts and the demo's picture: they show what they should, on the page and as files."""

import base64
from collections.abc import Callable
import re
import sys
from typing import Any
import warnings
import xml.etree.ElementTree

from convseq_ros.errors import ConvseqError
from convseq_ros.evaluation import plots
from convseq_ros.evaluation.report.charts import run_charts, set_charts
from convseq_ros.evaluation.report.verdict import Seen
from convseq_ros.evaluation.run_folder import Run
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


# Charts.

MakeRun = Callable[..., Run]
TABLE = [
    {'said': 0.2, 'right': 0.1, 'count': 4, 'low': 0, 'high': 0.5},
    {'said': 0.9, 'right': 0.8, 'count': 900, 'low': 0.5, 'high': 1},
]
CURVE = ([0.1, 0.5], [1.0, 0.8])


@pytest.fixture
def make(tmp_path) -> MakeRun:
    """Return a function that writes a run of the set `place`; see its arguments."""

    def make_run(
        name: str = 'a',
        scores: np.ndarray | None = SCORES,
        curve: tuple[Any, Any] = CURVE,
        **summary: Any,
    ) -> Run:
        folder = tmp_path / 'place' / name
        folder.mkdir(parents=True)
        (folder.parent / 'set.json').write_text('{}')
        if scores is not None:
            right = abs(np.subtract.outer(*map(np.arange, scores.shape))) <= 2
            np.savez(folder.parent / 'truth.npz', right=right)
            np.save(folder / 'scores.npy', scores)
        lines = [f'{recall},{precision}' for recall, precision in zip(*curve, strict=True)]
        (folder / 'curve.csv').write_text('\n'.join(['recall,precision', *lines]))
        told = {
            'accuracy_matched': 0.7,
            'accuracy_matched_low': 0.6,
            'accuracy_matched_high': 0.8,
            'accuracy_all': 0.5,
            'calibration': {'as_shipped': TABLE},
            'configuration': {'sequence': {'entropy_threshold': 0.5}},
        }
        return Run('place', name, folder, told | summary, [])

    return make_run


def row(query: int, verdict: str, best: int | None, length: int = 2) -> Seen:
    right = verdict == 'right'
    return Seen(query, verdict, best, query, right, True, False, length, 1, 0, 0.4, '', '')


ROWS = [
    row(0, 'skipped', None, 0), row(1, 'right', 1), row(2, 'wrong', 30), row(3, 'rejected', 9, 1),
]  # fmt: skip


def of_set(*runs: Run) -> dict[str, str]:
    numbers = {run.method: number for number, run in enumerate(runs)}
    return {name: chart.svg() for name, chart in set_charts(runs, numbers).items()}


def of_run(run: Run, rows: list[Seen] = ROWS) -> dict[str, str]:
    return {name: chart.svg() for name, chart in run_charts(run, rows).items()}


def picture_in(svg: str) -> np.ndarray:
    found = re.search(r'<image href="data:image/png;base64,([^"]+)"', svg)
    assert found
    content = np.frombuffer(base64.b64decode(found[1]), np.uint8)
    return cv2.imdecode(content, cv2.IMREAD_UNCHANGED)[..., :3].astype(int)


def words_in(svg: str) -> list[str]:
    return re.findall(r'<text[^>]*>([^<]+)</text>', svg)


def test_every_chart_is_a_png_an_svg_and_a_pdf_that_are_the_same_each_time(make, tmp_path):
    run, empty = make('a'), make('b', None, ([], []))
    files = []
    for folder in (tmp_path / 'one', tmp_path / 'two'):
        folder.mkdir()
        charts = set_charts([run, empty], {'a': 0, 'b': 1}) | run_charts(run, ROWS)
        assert [*charts] == ['curves', 'reliability', 'accuracy', 'matrix', 'lengths']
        for name, chart in charts.items():
            chart.save(*(folder / f'{name}.{kind}' for kind in ('png', 'svg', 'pdf')))
        files.append({path.name: path.read_bytes() for path in folder.iterdir()})
    assert files[0] == files[1]
    assert len(files[0]) == 15
    for name, content in files[0].items():
        if name.endswith('.png'):
            assert cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR).std() > 1
        elif name.endswith('.svg'):
            assert xml.etree.ElementTree.fromstring(content).tag.endswith('svg')
        else:
            assert content.startswith(b'%PDF')
        assert b'dc:date' not in content and b'CreationDate' not in content


def test_charts_have_the_pages_colours_there_and_its_light_ones_in_files(make, tmp_path):
    runs = [make('a'), make('b')]
    charts = set_charts(runs, {'a': 0, 'b': 11})
    for name, chart in charts.items():
        assert {'var(--c0)', 'var(--c1)', 'var(--rule)'} <= set(
            re.findall(r'var.*?\)', chart.svg())
        )
        assert not re.findall(r'(?:fill|stroke): #', chart.svg())
        chart.save(tmp_path / f'{name}.svg')
        text = (tmp_path / f'{name}.svg').read_text()
        assert '#0b62b0' in text and 'var(' not in text
    assert 'stroke-dasharray' in charts['curves'].svg()
    assert 'stroke-dasharray' not in of_set(*runs)['curves']


def test_scores_truth_and_dots_look_the_same_in_light_and_dark(make):
    svg = of_run(make())['matrix']
    colors = set(re.findall(r'(?:fill|stroke): (#\w+)', svg))
    assert {'#ffffff', '#4ade80', '#ff6b6b', '#f5bd4f'} <= colors


def test_title_and_legend_are_for_files_only(make, tmp_path):
    chart = run_charts(make(), ROWS)['matrix']
    height, width = (float(one) for one in re.findall(r'"0 0 (\S+) (\S+)"', chart.svg())[0][::-1])
    assert set(words_in(chart.svg())) >= {'query', 'reference'}
    assert not {'place: a', '1 right'} & set(words_in(chart.svg()))
    chart.save(tmp_path / 'a.png')
    image = cv2.imread(str(tmp_path / 'a.png'))
    assert image.shape[0] > height * 150 / 72
    assert image.shape[1] > (width + 60) * 150 / 72


def test_parts_of_a_chart_tell_their_method_and_numbers(make):
    charts = of_set(make('a<b', auc_pr=0.25), make('c', accuracy_matched=None))
    assert '<g data-series="a&lt;b"><title>a&lt;b: AUC-PR 0.250</title>' in charts['curves']
    assert '<g data-series="c"><title>c: -</title>' in charts['accuracy']
    assert 'c: 900 frames at 0.5 to 1, mean 0.900; 0.800 right' in charts['reliability']
    assert {'a<b', '0.700'} <= {one.replace('&lt;', '<') for one in words_in(charts['accuracy'])}


def test_a_name_is_no_formula(make, tmp_path):
    run = make(r'a $\no$ $formula$')
    charts = set_charts([run], {run.method: 0})
    assert run.method in words_in(charts['accuracy'].svg())
    charts['curves'].save(tmp_path / 'a.png')


def test_bars_and_curves_end_at_their_values(make):
    charts = of_set(make('a'))
    (bar,) = re.findall(r'd="([^"]*)"[^>]*fill: var\(--c0\)', charts['accuracy'])
    places = [float(one) for one in re.findall(r'[ML] (\S+)', bar)]
    assert (min(places), max(places)) == pytest.approx((190, 190 + 0.7 * 285), abs=0.1)
    curve = re.findall(r'd="([^"]*)"[^>]*stroke: var\(--c0\)', charts['curves'])[0]
    last = [float(one) for one in curve.split()[-2:]]
    assert last == pytest.approx([48 + 0.5 * 480, 28 + 0.2 * 340], abs=0.1)


def test_a_dot_lies_at_its_query_and_reference(make):
    svg = of_run(make())['matrix']
    ((x, y),) = re.findall(r'<use [^>]*x="(\S+)" y="(\S+)"[^>]*fill: #ff6b6b', svg)
    expected = (44 + 320 * 30.5 / 40, 26 + 240 * 2.5 / 30)
    assert (float(x), float(y)) == pytest.approx(expected, abs=0.1)


def test_a_long_curve_is_thinned_and_keeps_both_ends(make):
    recall = np.linspace(0, 1, 50_000)
    precision = 0.9 - 0.4 * np.random.default_rng(3).random(50_000)
    svg = of_set(make('a', None, (recall, precision)))['curves']
    curve = re.findall(r'd="([^"]*)"[^>]*stroke: var\(--c0\)', svg)[0].split()
    assert len(svg) < 80_000
    assert float(curve[1]) == pytest.approx(48, abs=0.1)
    assert float(curve[-2]) == pytest.approx(48 + 480, abs=0.1)


def test_ticks_of_counts_are_whole(make):
    charts = of_run(make('a', SCORES[:3, :3]), [row(0, 'right', 0, 1), row(1, 'right', 1, 2)])
    words = [*'001122', 'query', 'reference']
    assert sorted(words_in(charts['matrix'])) == words
    lengths = words_in(charts['lengths'])
    assert lengths[: lengths.index('sequence length k')] == ['0', '1', '2']


def test_length_is_drawn_where_it_varies_over_one_pass(make):
    run = make('a', None)
    svg = of_run(run)['lengths']
    assert 'var(--wrong)' in svg and 'var(--rejected)' in svg
    assert 'entropy threshold 0.5' in words_in(svg)
    assert of_run(run, ROWS[1:3]) == {}
    assert 'var(--wrong)' not in of_run(run, [ROWS[0], ROWS[1]] * 2 + [ROWS[3]])['lengths']


def test_matrix_is_bright_where_scores_are_high_and_gray_where_there_are_none(make):
    scores = np.linspace(0, 1, 16, dtype=np.float32).reshape(4, 4)
    scores[3, 0] = np.nan
    image = picture_in(of_run(make('a', scores))['matrix'])
    assert image[3, 3].sum() > image[1, 1].sum() > image[0, 0].sum()
    assert len(set(image[3, 0])) == 1
    assert image[0, 0].sum() < image[3, 0].sum() < image[3, 3].sum()


def test_large_matrix_is_reduced_and_keeps_its_thin_path(make):
    scores = np.zeros((1000, 700), np.float32)
    scores[500, 333] = 1
    image = picture_in(of_run(make('a', scores))['matrix'])
    assert max(image.shape[:2]) <= 320
    assert image.max() > 200


def test_matrix_of_nothing_is_a_picture_too(make):
    assert picture_in(of_run(make('a', np.full((3, 3), np.nan, np.float32)))['matrix']).any()


def test_without_matplotlib_a_figure_gives_advice(monkeypatch):
    monkeypatch.setitem(sys.modules, 'matplotlib.figure', None)
    with pytest.raises(ConvseqError, match='pip install matplotlib'):
        plots.new_figure(1, 1)


def test_many_methods_find_room(make, tmp_path):
    runs = [make(f'a-method-of-some-length-{index}', None) for index in range(45)]
    heights = []
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        for some in (runs[:2], runs):
            numbers = {run.method: index for index, run in enumerate(some)}
            for chart in set_charts(some, numbers).values():
                chart.save(tmp_path / 'a.png')
                heights.append(cv2.imread(str(tmp_path / 'a.png')).shape[0])
    assert all(many > 1.5 * few for few, many in zip(heights[:3], heights[3:], strict=True))
