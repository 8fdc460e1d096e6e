# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The report of `convseq evaluate`: what is on the page, and that it works in a browser."""

import base64
from collections import Counter
from collections.abc import Iterator
import csv
import json
from pathlib import Path
import re
import shutil
import subprocess
import sys
from typing import Any
import urllib.request
import xml.etree.ElementTree

from convseq_ros.cli import main
from convseq_ros.errors import ConvseqError
from convseq_ros.evaluation.report import read_runs, write_report
from convseq_ros.evaluation.report.poses import in_words
from convseq_ros.evaluation.report.verdict import nearest_right, seen
from convseq_ros.results import COLUMNS
import cv2
import numpy as np
import pytest

pytest.importorskip('matplotlib')

NUM_FRAMES = 24
VERDICTS = {'right': 10, 'wrong': 5, 'rejected': 6, 'skipped': 3}
BROWSERS = ('chromium', 'chromium-browser', 'google-chrome', 'google-chrome-stable', 'chrome')


# Half a metre ahead, a quarter to the right, ten degrees to the left.
MEASURED = {
    'relative_x_m': '0.5000', 'relative_y_m': '-0.2500', 'relative_z_m': '0.0000',
    'relative_qx': '0.0', 'relative_qy': '0.0', 'relative_qz': '0.0871557',
    'relative_qw': '0.9961947', 'position_sigma_m': '0.1000', 'heading_sigma_rad': '0.01745',
}  # fmt: skip
DOTS = np.array([[0, 0, 255, 255], [51, 102, 153, 204]], np.uint8)


def write_set(folder: Path, name: str, protocol: str, base: str = '') -> None:
    """Write a set without methods; the fifth reference has no thumbnail."""
    place = folder / name
    place.mkdir(parents=True)
    told = {
        'name': name,
        'title': f'{name} <drawn> & $named',
        'protocol': protocol,
        'tolerance': 1,
        'queries': NUM_FRAMES,
        'references': NUM_FRAMES,
    }
    (place / 'set.json').write_text(json.dumps(told | ({'base': base} if base else {})))
    if base:
        return
    right = abs(np.subtract.outer(np.arange(NUM_FRAMES), np.arange(NUM_FRAMES))) <= 1
    right[-1] = False
    np.savez_compressed(place / 'truth.npz', right=right)
    if protocol == 'closed':
        poses = np.zeros((NUM_FRAMES, 7))
        poses[:, 0], poses[:, 6] = np.arange(NUM_FRAMES), 1.0
        there = poses + np.eye(7)[0] / 2
        np.savez_compressed(place / 'poses.npz', query=there, reference=poses)
    random = np.random.default_rng(len(name))
    for side in ('query',) if protocol == 'online' else ('query', 'reference'):
        (place / 'thumbnails' / side).mkdir(parents=True)
        for index in range(NUM_FRAMES):
            if (side, index) != ('reference', 4):
                image = random.integers(0, 256, (90, 160), np.uint8)
                path = place / 'thumbnails' / side / f'{index:06d}.jpg'
                path.write_bytes(cv2.imencode('.jpg', image)[1].tobytes())


def frame(index: int, half: str = '') -> dict[str, object]:
    """Return a row: skipped, then right, wrong and rejected in turn."""
    row = dict.fromkeys(COLUMNS, '') | {
        'query_index': index,
        'query_stamp_ns': index * 10**8,
        'status': 'skipped',
        'reason': 'warming_up',
        'sequence_length': 0,
        'pairs_scored': NUM_FRAMES,
        'duration_ms': '1.000',
        'correct': 0,
        'known': int(index < NUM_FRAMES - 1),
        'slip': 0,
        'margin': '',
        'entropy': f'{0.4 + index / 100:.3f}',
        'half': half,
    }
    if index < 3:
        return row
    verdict = 'right' if index < 13 else 'wrong' if index < 18 else 'rejected'
    best = index if verdict == 'right' else (index + 10) % NUM_FRAMES
    return row | {
        'status': 'rejected' if verdict == 'rejected' else 'accepted',
        'reason': 'ambiguous' if verdict == 'rejected' else 'accepted',
        'best_index': best,
        'best_score': '0.9000000',
        'sequence_length': 2 + index % 3,
        'correct': int(verdict == 'right'),
        'margin': '0.0100',
        'inliers': 2,
        **(MEASURED if verdict == 'right' else {}),
    }


def write_run(folder: Path, method: str, protocol: str, accuracy: float) -> None:
    """Write the run of one method."""
    place = folder / method
    place.mkdir()
    halves = ('first', 'last', 'middle') if protocol == 'open' else ('',)
    with (place / 'frames.csv').open('w', newline='') as file:
        table = csv.DictWriter(file, frame(0), lineterminator='\n')
        table.writeheader()
        table.writerows(frame(index, half) for half in halves for index in range(NUM_FRAMES))
    (place / 'curve.csv').write_text('threshold,precision,recall\n0.9,1.0,0.4\n0.1,0.6,0.5\n')
    if method == 'convseq' and protocol == 'closed':
        ends = 2 * np.arange(1, NUM_FRAMES + 1)
        np.savez_compressed(place / 'fields.npz', dots=np.tile(DOTS, (NUM_FRAMES, 1)), ends=ends)
    if protocol != 'open':
        scores = np.random.default_rng(2).random((NUM_FRAMES, NUM_FRAMES)).astype(np.float32)
        scores[:3] = np.nan
        np.save(place / 'scores.npy', scores)
    (place / 'summary.json').write_text(
        json.dumps(
            {
                'set': folder.name,
                'method': method,
                'protocol': protocol,
                'queries': NUM_FRAMES,
                'matched': 21,
                'known': 23,
                'matched_known': 20,
                'accuracy_matched': accuracy,
                'accuracy_all': accuracy - 0.1,
                'accuracy_matched_low': accuracy - 0.2,
                'accuracy_matched_high': accuracy + 0.05,
                'auc_pr': None,
                'recall_at_100_precision': 0.4,
                'accepted': 15,
                'accepted_right': 10,
                'false_closures': 5,
                'slips': 0,
                'mean_k': 3.0,
                'frames_to_first_closure': dict(zip(halves, (3, None, 0), strict=False)),
                'metres_to_first_closure': dict(zip(halves, (4.5, None, 0), strict=False)),
                'encode_ms': 1.5,
                'frame_ms': 2.5,
                'k_distribution': {'2': 7, '3': 7, '4': 7},
                'criterion': 'margin',
                'transferred': None,
                'configuration': {'entropy_threshold': 0.5},
                'versions': {'convseq_ros': '0.1.0'},
                'machine': {'processor': 'a test'},
                'argv': ['convseq', 'evaluate', '</script>'],
                'date': '2026-01-02T03:04:05',
                'notes': [],
                'pcu': None,
            }
        )
    )


@pytest.fixture(scope='module')
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a results folder with three sets, one for each protocol."""
    folder = tmp_path_factory.mktemp('report') / 'results'
    write_set(folder, 'street', 'closed')
    write_run(folder / 'street', 'convseq', 'closed', 0.9)
    write_run(folder / 'street', 'cohog', 'closed', 0.6)
    write_set(folder, 'street-open', 'open', base='street')
    write_run(folder / 'street-open', 'convseq', 'open', 0.8)
    write_set(folder, 'loop', 'online')
    write_run(folder / 'loop', 'convseq', 'online', 0.7)
    return folder


@pytest.fixture(scope='module')
def page(results: Path) -> Path:
    """Return the page of these results."""
    output = results.parent / 'report.html'
    write_report(read_runs([results]), output)
    return output


@pytest.fixture
def copy(results: Path, tmp_path: Path) -> Path:
    """Return a copy of the results that may be damaged."""
    return Path(shutil.copytree(results, tmp_path / 'copy'))


def embedded(page: Path) -> dict[str, Any]:
    text = page.read_text(encoding='utf-8')
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.S)
    assert found
    return json.loads(found[1])


def drawn(page: Path) -> list[str]:
    return re.findall(r'<svg viewBox.*?</svg>', page.read_text(encoding='utf-8'), re.S)


# What is on the page.


def test_page_names_every_set_and_method_with_its_numbers(page):
    text = page.read_text(encoding='utf-8')
    interval = '0.700&ndash;0.950'
    for word in ('street', 'street-open', 'loop', 'convseq', 'cohog', '0.900', interval):
        assert f'>{word}' in text
    assert '>3 sets, 2 methods ' in text
    assert text.count('<tr>') == 1 + 4


def test_page_needs_no_network_and_no_other_file(page):
    text = page.read_text(encoding='utf-8')
    addresses = re.findall(r"""(?:src|href)="([^"]*)"|url\(([^)]*)\)|@import""", text)
    assert addresses
    assert all((one or other).startswith(('data:', '#')) for one, other in addresses)
    assert "default-src 'none'" in text


def test_every_chart_has_a_text_for_those_who_cannot_see_it(page):
    text = page.read_text(encoding='utf-8')
    assert all(
        'role="img"' in tag and 'aria-label="' in tag for tag in re.findall(r'<svg [^>]*>', text)
    )
    assert all('alt="' in tag for tag in re.findall(r'<img [^>]*>', text))


def test_charts_are_well_formed(page):
    charts = drawn(page)
    assert len(charts) >= 9
    for chart in charts:
        xml.etree.ElementTree.fromstring(chart)


def test_how_soon_places_are_known_is_drawn_for_every_part_of_the_map(page):
    told = [chart for chart in drawn(page) if 'first right closure' in chart]
    assert len(told) == 3
    for words in ('convseq first 3, 4.5 m', 'convseq last none', 'convseq middle 0, 0 m'):
        assert sum(words in chart for chart in told) == 1


def test_measured_poses_are_told_and_drawn_with_how_far_off_they_are(page):
    text, data = page.read_text(encoding='utf-8'), embedded(page)
    at = {name: place for place, name in enumerate(data['fields'])}
    rows = next(run['rows'] for run in data['runs'] if run['set'] == 'street')
    told = '0.50 m ahead, 0.25 m right, 0.00 m up (± 0.10 m), turned 10.0° left (± 1.0°)'
    assert [row[at['pose']] for row in rows] == [''] * 3 + [told] * 10 + [''] * 11
    assert base64.b64decode(rows[5][at['dots']]) == DOTS.tobytes()
    assert text.count('10 poses, 0.25 m and 10.00° off the truth in the median') == 4
    # A position that is not known, and nothing at all.
    assert in_words({**MEASURED, 'relative_x_m': ''}) == 'turned 10.0° left (± 1.0°)'
    assert in_words({}) == ''


@pytest.mark.parametrize(
    'name, arrays',
    [
        ('street/convseq/fields.npz', {'dots': DOTS, 'ends': np.array([2])}),
        ('street/convseq/fields.npz', {'dots': DOTS[:, :3], 'ends': np.arange(NUM_FRAMES)}),
        ('street/convseq/fields.npz', {'dots': DOTS, 'ends': np.full(NUM_FRAMES, 0.5)}),
        ('street/poses.npz', {'query': np.zeros((2, 7)), 'reference': np.zeros((2, 7))}),
        ('street/poses.npz', {'query': np.zeros(7), 'reference': np.zeros((NUM_FRAMES, 6))}),
    ],
)
def test_damaged_geometry_is_refused(copy, name, arrays):
    np.savez_compressed(copy / name, **arrays)
    with pytest.raises(ConvseqError, match='damaged results; run `convseq evaluate` again'):
        read_runs([copy])


def test_page_is_the_same_each_time(results, page, tmp_path):
    write_report(read_runs([results]), tmp_path / 'page.html')
    assert (tmp_path / 'page.html').read_bytes() == page.read_bytes()


def test_one_set_and_one_method_are_not_plural(results, tmp_path):
    runs = [run for run in read_runs([results]) if run.set == 'loop']
    write_report(runs, tmp_path / 'page.html')
    assert '>1 set, 1 method ' in (tmp_path / 'page.html').read_text(encoding='utf-8')


def test_names_and_titles_are_escaped(page):
    text = page.read_text(encoding='utf-8')
    assert 'street &lt;drawn&gt; &amp; $named' in text
    assert text.count('</script>') == 2


def test_verdicts_are_those_of_the_table(results):
    run = next(run for run in read_runs([results]) if run.set == 'street')
    assert Counter(one.verdict for one in seen(run, run.truth())) == VERDICTS


def test_each_thumbnail_is_held_once_and_a_missing_one_is_left_out(page):
    data = embedded(page)
    assert len(data['pictures']) == len(set(data['pictures'])) == 3 * NUM_FRAMES - 1
    at = {name: place for place, name in enumerate(data['fields'])}
    rows = next(run['rows'] for run in data['runs'] if run['set'] == 'street')
    assert rows[4][at['best']] == 4
    assert rows[4][at['best_picture']] is None
    assert rows[5][at['best_picture']] is not None


def test_damaged_thumbnail_is_left_out(copy, tmp_path):
    (copy / 'street' / 'thumbnails' / 'query' / '000005.jpg').write_bytes(b'\xff\xd8\xff no')
    write_report(read_runs([copy]), tmp_path / 'page.html')
    data = embedded(tmp_path / 'page.html')
    rows = next(run['rows'] for run in data['runs'] if run['set'] == 'street')
    assert rows[5][data['fields'].index('query_picture')] is None


def test_run_without_thumbnails_scores_and_curve_still_has_its_row(copy, tmp_path):
    for path in (
        *copy.glob('*/thumbnails'),
        *copy.glob('*/*/scores.npy'),
        *copy.glob('*/*/curve.csv'),
    ):
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    write_report(read_runs([copy]), tmp_path / 'page.html')
    assert embedded(tmp_path / 'page.html')['pictures'] == []
    assert 'Similarity matrices' not in (tmp_path / 'page.html').read_text(encoding='utf-8')


def test_small_page_is_asked_for_and_frames_are_thinned_with_a_note(results, page, tmp_path):
    most = 0.7 * page.stat().st_size / 1e6
    write_report(read_runs([results]), tmp_path / 'small.html', most)
    text = (tmp_path / 'small.html').read_text(encoding='utf-8')
    assert len(text.encode()) <= most * 1e6
    assert 'one frame in' in text
    assert 'one frame in' not in page.read_text(encoding='utf-8')


def test_page_that_cannot_be_small_enough_is_refused(results, tmp_path):
    with pytest.raises(ConvseqError, match=r'MB are allowed; give fewer results'):
        write_report(read_runs([results]), tmp_path / 'page.html', 0.01)
    assert not list(tmp_path.iterdir())


def test_two_results_of_the_same_set_and_method_are_told_apart(results, copy):
    methods = [run.method for run in read_runs([results, copy]) if run.set == 'loop']
    assert sorted(methods) == ['convseq', 'convseq (copy)']


# Its parts.


def test_truth_to_show_is_the_middle_of_the_run_nearest_to_the_match():
    right = np.isin(np.arange(20), [2, 3, 4, 10, 11, 12, 13, 14])
    assert nearest_right(right, 5) == 3
    assert nearest_right(right, 19) == 12
    assert nearest_right(right, None) == 12
    assert nearest_right(np.zeros(20, bool), 5) is None


# The command.


def test_command_writes_page_and_figures(results, tmp_path, capsys):
    output, figures = tmp_path / 'report.html', tmp_path / 'figures'
    assert main(['report', str(results / 'street'), '--output', str(output)]) == 1
    assert 'convseq evaluate' in capsys.readouterr().err
    assert main(['report', str(results), '--output', str(output), '--figures', str(figures)]) == 0
    assert output.exists()
    names = {path.name for path in figures.iterdir()}
    for stem in (
        'street-curves',
        'street-accuracy',
        'street-convseq-matrix',
        'street-convseq-lengths',
        'loop-convseq-matrix',
    ):
        assert {f'{stem}.png', f'{stem}.svg', f'{stem}.pdf'} <= names
    assert not [name for name in names if name.startswith('street-open-convseq-m')]
    assert capsys.readouterr().out == ''


def one_line(captured: str) -> bool:
    return captured.startswith('convseq report: ') and captured.count('\n') == 1


def test_folder_that_is_no_result_is_refused_in_one_line(tmp_path, capsys):
    for folder in (tmp_path, tmp_path / 'missing'):
        assert main(['report', str(folder), '--output', str(tmp_path / 'page.html')]) == 1
        told = capsys.readouterr().err
        assert one_line(told)
        assert str(folder) in told
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ('name', 'content'),
    [
        ('summary.json', '{"set": "street", '),
        ('summary.json', '[]'),
        ('frames.csv', 'query_index\n1\n'),
        ('frames.csv', ''),
        ('curve.csv', 'threshold,precision\n1,2\n'),
        ('curve.csv', 'threshold,precision,recall\n1,two,3\n'),
        ('scores.npy', 'no matrix'),
        ('scores.npy', ''),
        ('../truth.npz', 'no matrix'),
        ('../set.json', '[1'),
    ],
)
def test_damaged_file_is_named_in_one_line(copy, tmp_path, capsys, name, content):
    (copy / 'street' / 'cohog' / name).write_text(content)
    assert main(['report', str(copy), '--output', str(tmp_path / 'page.html')]) == 1
    told = capsys.readouterr().err
    assert one_line(told)
    assert re.search(r'street./?(cohog|convseq|truth\.npz)', told)
    assert not (tmp_path / 'page.html').exists()


def test_damaged_number_is_named_with_its_row(copy, tmp_path, capsys):
    path = copy / 'street' / 'cohog' / 'frames.csv'
    path.write_text(path.read_text().replace('0.9000000', 'high', 1))
    assert main(['report', str(copy), '--output', str(tmp_path / 'page.html')]) == 1
    assert 'row 4 is damaged' in capsys.readouterr().err


def test_page_needs_matplotlib_and_says_so(results, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, 'matplotlib.figure', None)
    assert main(['report', str(results), '--output', str(tmp_path / 'page.html')]) == 1
    told = capsys.readouterr().err
    assert one_line(told)
    assert told.endswith('figures need matplotlib: pip install matplotlib\n')
    assert not list(tmp_path.iterdir())


# In a browser.


class Browser:
    """Headless Chromium over chromedriver's own protocol, which is JSON over HTTP."""

    def __init__(self, driver: str, browser: str) -> None:
        self._driver = subprocess.Popen([driver, '--port=0'], stdout=subprocess.PIPE, text=True)
        assert self._driver.stdout
        port = next(
            found[1]
            for line in self._driver.stdout
            if (found := re.search(r'started successfully on port (\d+)', line))
        )
        self._session = f'http://127.0.0.1:{port}/session'
        options = {
            'binary': browser,
            'args': [
                '--headless=new',
                '--no-sandbox',
                '--disable-gpu',
                '--disable-dev-shm-usage',
                '--window-size=1280,1000',
            ],
        }
        wanted = {'goog:chromeOptions': options, 'goog:loggingPrefs': {'browser': 'ALL'}}
        opened = self._ask('', {'capabilities': {'alwaysMatch': wanted}})
        self._session += '/' + opened['sessionId']

    def _ask(self, path: str, body: dict[str, object] | None, method: str = 'POST') -> Any:
        content = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(self._session + path, content, method=method)
        with urllib.request.urlopen(request, timeout=60) as answer:
            return json.load(answer)['value']

    def open(self, address: str) -> None:
        self._ask('/url', {'url': 'about:blank'})
        self._ask('/url', {'url': address})

    def run(self, script: str, *values: object) -> Any:
        return self._ask('/execute/sync', {'script': script, 'args': list(values)})

    def wait(self, script: str) -> Any:
        """Run a script whose promise is waited for."""
        call = f'const done = arguments[0]; (async () => {{ {script} }})().then(done);'
        return self._ask('/execute/async', {'script': call, 'args': []})

    def press(self, *keys: str) -> None:
        steps = [{'type': kind, 'value': key} for key in keys for kind in ('keyDown', 'keyUp')]
        self._ask('/actions', {'actions': [{'type': 'key', 'id': 'keys', 'actions': steps}]})

    def complaints(self) -> list[dict[str, Any]]:
        return self._ask('/se/log', {'type': 'browser'})

    def prefer(self, scheme: str) -> None:
        features = [{'name': 'prefers-color-scheme', 'value': scheme}]
        command = {'cmd': 'Emulation.setEmulatedMedia', 'params': {'features': features}}
        self._ask('/goog/cdp/execute', command)

    def screenshot(self) -> bytes:
        return base64.b64decode(self._ask('/screenshot', None, 'GET'))

    def close(self) -> None:
        try:
            self._ask('', None, 'DELETE')
        finally:
            self._driver.terminate()
            self._driver.wait(10)
            if self._driver.stdout:
                self._driver.stdout.close()


@pytest.fixture(scope='module')
def driven() -> Iterator[Browser]:
    """Yield a browser; skip where there is none."""
    driver = shutil.which('chromedriver')
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if not (driver and browser):
        pytest.skip('needs chromium and chromedriver on the PATH (apt: chromium chromium-driver)')
    opened = Browser(driver, browser)
    yield opened
    opened.close()


@pytest.fixture
def browser(driven: Browser, page: Path) -> Iterator[Browser]:
    """Yield a browser at the page, and see that the page did not complain afterwards."""
    driven.open(page.as_uri())
    yield driven
    assert driven.complaints() == []


RIGHT_ARROW, LEFT_ARROW = '\ue014', '\ue012'
CAPTION = 'return document.getElementById("query-caption").firstChild.textContent'
COUNT = 'return document.getElementById("count").textContent'


def test_every_picture_loads(browser):
    sizes = browser.wait("""
        const seen = [];
        const look = async () => {
          for (const image of document.images) {
            if (!image.hidden) { await image.decode(); seen.push(image.naturalWidth); }
          }
        };
        await look();
        const run = document.getElementById('run');
        for (let at = 0; at < run.options.length; at += 1) {
          run.value = at;
          run.dispatchEvent(new Event('change'));
          const slider = document.getElementById('slider');
          slider.value = 0;
          slider.dispatchEvent(new Event('input'));
          for (let frame = 0; frame < 24; frame += 1) {
            await look();
            document.getElementById('next').click();
          }
        }
        return seen;
    """)
    assert len(sizes) > 4 * NUM_FRAMES
    assert min(sizes) > 0


def test_inliers_are_drawn_over_both_pictures_where_they_are(browser, page):
    browser.open(page.as_uri() + '#street/convseq/5')
    dots = """return [...document.querySelectorAll('svg.dots')].map((plate) =>
        [...plate.children].map((dot) => ['cx', 'cy'].map((name) => +dot.getAttribute(name))))"""
    browser.wait('await document.getElementById("match").decode();')
    assert browser.run(dots) == [[[0, 0], [64, 18]], [[160, 90], [128, 54]]]
    browser.run('document.getElementById("dots").click()')
    assert browser.run(dots) == [[], []]
    browser.run('document.getElementById("dots").click()')
    browser.open(page.as_uri() + '#street/cohog/5')
    assert browser.run(dots) == [[], []]


def test_filter_shows_only_frames_of_its_kind(browser):
    for kind, number in VERDICTS.items():
        browser.run(f'document.querySelector("[data-kind={kind}]").click()')
        browser.run(
            'document.getElementById("slider").value = 0;'
            'document.getElementById("slider").dispatchEvent(new Event("input"))'
        )
        assert browser.run(COUNT) == f'1 of {number}'
        for _ in range(number):
            verdict = browser.run('return document.getElementById("verdict").classList[1]')
            assert verdict == kind
            browser.run('document.getElementById("next").click()')
        assert browser.run('return document.getElementById("next").disabled')


def test_arrow_keys_move_from_frame_to_frame(browser):
    assert browser.run(CAPTION) == 'Query 3'
    browser.press(RIGHT_ARROW, RIGHT_ARROW, RIGHT_ARROW)
    assert browser.run(CAPTION) == 'Query 6'
    browser.press(LEFT_ARROW)
    assert browser.run(CAPTION) == 'Query 5'
    browser.press(*[LEFT_ARROW] * 7)
    assert browser.run(CAPTION) == 'Query 0'


def test_first_pair_is_a_right_match_else_a_wrong_one(browser, copy, tmp_path):
    table = copy / 'street' / 'convseq' / 'frames.csv'
    for old, new, first in (
        ('3,300000000,accepted,accepted,', '3,300000000,rejected,ambiguous,', 'Query 4'),
        (',1,1,0,0.0100,', ',0,1,0,0.0100,', 'Query 4'),
        ('accepted,accepted,', 'rejected,ambiguous,', 'Query 3'),
    ):
        assert old in table.read_text()
        table.write_text(table.read_text().replace(old, new))
        runs = [run for run in read_runs([copy]) if run.set == 'street']
        write_report(runs, tmp_path / 'page.html')
        for address in ('', '#street/convseq'):
            browser.open((tmp_path / 'page.html').as_uri() + address)
            assert browser.run(CAPTION) == first


def test_method_in_the_table_leads_to_its_first_right_match(browser):
    browser.run('document.querySelector("tbody a[href=\'#street/cohog\']").click()')
    browser.wait('await new Promise((done) => setTimeout(done, 50));')
    assert browser.run(CAPTION) == 'Query 3'
    assert browser.run('return document.getElementById("run").selectedOptions[0].text') == (
        'street / cohog'
    )


def test_address_leads_to_its_frame_and_follows_it(browser, page):
    browser.open(page.as_uri() + '#street/cohog/14/wrong')
    assert browser.run(CAPTION) == 'Query 14'
    assert browser.run(COUNT) == '2 of 5'
    browser.press(RIGHT_ARROW)
    assert browser.run('return location.hash') == '#street/cohog/15/wrong'
    browser.open(page.as_uri() + '#no/such/%E0%A4%A')
    assert browser.run(CAPTION) == 'Query 3'


def test_frame_of_the_open_protocol_is_found_again(browser, page):
    browser.open(page.as_uri() + '#street-open/convseq/30.')
    assert browser.run(CAPTION) == 'Query 6'
    assert 'last half' in browser.run('return document.getElementById("verdict").textContent')


def test_rejecting_a_place_that_is_not_in_the_map_is_called_right(browser, page):
    browser.open(page.as_uri() + '#street/cohog/23')
    told = browser.run('return document.getElementById("verdict").textContent')
    assert told == 'Rightly rejected (ambiguous): this place is not in the map.'


def test_click_in_a_matrix_shows_the_pictures_of_its_row(browser):
    browser.run("""
        const plate = document.querySelector('.plate[data-run="street/cohog"]');
        const box = plate.querySelector('image').getBoundingClientRect();
        const clientY = box.top + box.height * 12.5 / 24;
        plate.dispatchEvent(new MouseEvent('click', {clientY, bubbles: true}));
    """)
    browser.wait('await new Promise((done) => setTimeout(done, 50));')
    assert browser.run('return location.hash') == '#street/cohog/12'
    assert browser.run(CAPTION) == 'Query 12'


def test_heading_sorts_the_table_both_ways(browser):
    column = """return [...document.querySelectorAll('tbody tr')]
        .map((row) => Number(row.querySelector('.number').dataset.value))"""
    click = 'document.querySelectorAll("thead button")[2].click()'
    browser.run(click)
    assert browser.run(column) == [0.9, 0.8, 0.7, 0.6]
    browser.run(click)
    assert browser.run(column) == [0.6, 0.7, 0.8, 0.9]
    assert (
        browser.run('return document.querySelectorAll("thead th")[2].getAttribute("aria-sort")')
        == 'ascending'
    )


def test_scheme_is_the_systems_until_the_button_chooses(browser, page):
    brightness = """
        const [red, green, blue] = getComputedStyle(document.body).backgroundColor.match(/\\d+/g);
        return Number(red) + Number(green) + Number(blue);"""
    browser.prefer('dark')
    assert browser.run(brightness) < 200
    browser.run('document.getElementById("scheme").click()')
    assert browser.run(brightness) > 600
    browser.open(page.as_uri())
    assert browser.run(brightness) > 600
    browser.run('document.getElementById("scheme").click()')
    browser.run('document.getElementById("scheme").click()')
    assert browser.run(brightness) < 200
    browser.prefer('light')
    assert browser.run(brightness) > 600


def test_charts_have_the_type_and_the_scheme_of_the_page(browser):
    styles = 'const [page, text, line] = ["body", ".chart text", ".chart path[style*=stroke]"]'
    styles += '.map((one) => getComputedStyle(document.querySelector(one)));'
    fonts = browser.run(f'{styles} return [page.fontFamily, text.fontFamily]')
    assert fonts[0] == fonts[1]
    shades = []
    for scheme in ('dark', 'light'):
        browser.prefer(scheme)
        colors = browser.run(f'{styles} return [page.color, text.fill, line.stroke]')
        shades.append([sum(map(int, re.findall(r'\d+', color))) for color in colors])
    page, text, line = np.subtract(*shades)
    assert page > 300 and text > 100 and line < -300


def test_method_in_the_legend_stands_out(browser):
    browser.run('document.querySelector(".legend li[data-series=cohog]").focus()')
    street = 'document.getElementById("set-street")'
    assert browser.run(f'return {street}.classList.contains("picking")')
    shown = browser.wait("""
        await new Promise((done) => setTimeout(done, 400));
        const of = (item) => `${item.dataset.series} ${getComputedStyle(item).opacity}`;
        return [...document.querySelectorAll('#set-street .charts figure')].map((figure) =>
            [...new Set([...figure.querySelectorAll('[data-series]')].map(of))].sort());""")
    assert shown == [['cohog 1', 'convseq 0.15']] * 3


def test_page_is_no_wider_than_a_phone(browser):
    wide = browser.wait("""
        document.body.style.width = '360px';
        const width = document.querySelector('main').scrollWidth;
        document.body.style.width = '';
        return width;
    """)
    assert wide <= 360


def test_the_time_a_frame_takes_is_seen_on_a_screen_of_1280_px(browser):
    """Real names are longer, as long as those of Gardens Point."""
    ends = browser.run("""
        document.body.style.width = '1265px';
        for (const cell of document.querySelectorAll('table tbody tr > *:first-child')) {
          cell.firstChild.textContent = 'gardens_point_day_day';
        }
        const heads = [...document.querySelectorAll('thead th')];
        const frame = heads.find((head) => head.textContent.trim() === 'Frame');
        const table = document.querySelector('.scroll').getBoundingClientRect();
        const ends = [frame.getBoundingClientRect().right, table.right];
        document.body.style.width = '';
        return ends;
    """)
    assert ends[0] <= ends[1]


def test_page_looks_like_something(browser):
    image = cv2.imdecode(np.frombuffer(browser.screenshot(), np.uint8), cv2.IMREAD_COLOR)
    assert image.std() > 10


@pytest.mark.parametrize('name', ['summary.json', '../set.json'])
def test_a_file_that_is_nested_too_deeply_is_one_line(copy, tmp_path, capsys, name):
    (copy / 'street' / 'cohog' / name).write_text('[' * 100_000)
    assert main(['report', str(copy), '--output', str(tmp_path / 'page.html')]) == 1
    assert one_line(capsys.readouterr().err)


def test_a_matrix_that_declares_terabytes_is_one_line(copy, tmp_path, capsys):
    header = "{'descr': '<f4', 'fortran_order': False, 'shape': (1000000, 1000000), }".ljust(117)
    content = b'\x93NUMPY\x01\x00\x76\x00' + header.encode() + b'\n'
    (copy / 'street' / 'cohog' / 'scores.npy').write_bytes(content)
    assert main(['report', str(copy), '--output', str(tmp_path / 'page.html')]) == 1
    assert one_line(capsys.readouterr().err)
