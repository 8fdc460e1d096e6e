# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The report of `convseq evaluate`: what is on the page, and that it works in a browser."""

from collections import Counter
import csv
import json
from pathlib import Path
import re
import shutil
import sys
import xml.etree.ElementTree

from convseq_ros.app.result_row import COLUMNS
from convseq_ros.cli import main
from convseq_ros.errors import SourceError
from convseq_ros.evaluation.report.page import write_report
from convseq_ros.evaluation.report.shown import read_runs, right_to_show
import cv2
import numpy as np
import pytest
from web_page import data_of, shown

pytest.importorskip('matplotlib')

NUM_FRAMES = 24
VERDICTS = {'right': 10, 'wrong': 5, 'rejected': 6, 'skipped': 3}


def write_set(folder: Path, name: str, protocol: str, base: str = '') -> None:
    """Write a set without methods; the fifth reference has no thumbnail."""
    place = folder / name
    place.mkdir(parents=True)
    about = {'name': name, 'title': f'{name} <drawn> & $named', 'protocol': protocol}
    about |= {'tolerance': 1, 'queries': NUM_FRAMES, 'references': NUM_FRAMES}
    (place / 'set.json').write_text(json.dumps(about | ({'base': base} if base else {})))
    if base:
        return
    right = abs(np.subtract.outer(np.arange(NUM_FRAMES), np.arange(NUM_FRAMES))) <= 1
    right[-1] = False
    np.save(place / 'truth.npy', right)
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
        'query_index': index, 'query_stamp_ns': index * 10**8, 'status': 'skipped',
        'reason': 'warming_up', 'sequence_length': 0, 'pairs_scored': NUM_FRAMES,
        'duration_ms': '1.000', 'correct': 0, 'known': int(index < NUM_FRAMES - 1), 'slip': 0,
        'margin': '', 'entropy': f'{0.4 + index / 100:.3f}', 'half': half,
    }  # fmt: skip
    if index < 3:
        return row
    verdict = 'right' if index < 13 else 'wrong' if index < 18 else 'rejected'
    return row | {
        'status': 'rejected' if verdict == 'rejected' else 'accepted',
        'reason': 'ambiguous' if verdict == 'rejected' else 'accepted',
        'best_index': index if verdict == 'right' else (index + 10) % NUM_FRAMES,
        'best_score': '0.9000000', 'sequence_length': 2 + index % 3,
        'correct': int(verdict == 'right'), 'margin': '0.0100', 'inliers': 2,
    }  # fmt: skip


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
    if protocol != 'open':
        scores = np.random.default_rng(2).random((NUM_FRAMES, NUM_FRAMES)).astype(np.float32)
        scores[:3] = np.nan
        np.save(place / 'scores.npy', scores)
    summary = {
        'set': folder.name, 'method': method, 'protocol': protocol, 'queries': NUM_FRAMES,
        'matched': 21, 'known': 23, 'matched_known': 20, 'accuracy_matched': accuracy,
        'accuracy_all': accuracy - 0.1, 'accuracy_matched_low': accuracy - 0.2,
        'accuracy_matched_high': accuracy + 0.05, 'auc_pr': None, 'accepted_recall': 0.43,
        'recall_at_100_precision': 0.4, 'false_closures': 5, 'slips': 0, 'mean_k': 3.0,
        'frames_to_first_closure': dict(zip(halves, (3, None, 0), strict=False)),
        'encode_ms': 1.5, 'frame_ms': 2.5, 'criterion': 'margin',
        'calibration': {'as_shipped': [{'said': 0.9, 'right': 0.8, 'count': 9}]},
        'configuration': {'entropy_threshold': 0.5}, 'machine': {'cpu': 'a test'},
        'argv': ['convseq', 'evaluate', '</script>'], 'date': '2026-01-02T03:04:05',
    }  # fmt: skip
    (place / 'summary.json').write_text(json.dumps(summary))


@pytest.fixture(scope='module')
def results(tmp_path_factory) -> Path:
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
def page(results) -> Path:
    """Return the page of these results."""
    output = results.parent / 'report.html'
    write_report(read_runs([results]), output)
    return output


@pytest.fixture
def copy(results, tmp_path) -> Path:
    """Return a copy of the results that may be damaged."""
    return Path(shutil.copytree(results, tmp_path / 'copy'))


def embedded(page):
    """Return the pictures, and the rows of the first method on the street."""
    data = data_of(page)
    run = next(one for one in data['runs'] if (one['set'], one['method']) == ('street', 'convseq'))
    return data['pictures'], run['rows']


def test_page_names_every_set_and_method_with_its_numbers(page):
    text = page.read_text(encoding='utf-8')
    for word in ('street', 'street-open', 'loop', 'convseq', 'cohog', '0.900', '0.70-0.95'):
        assert f'>{word}<' in text
    assert '>3, -, 0<' in text
    assert text.count('<tr>') == 1 + 4
    assert 'class=best' in text


def test_page_needs_no_network_and_no_other_file(page):
    text = page.read_text(encoding='utf-8')
    addresses = re.findall(r"""(?:src|href)="([^"]*)"|url\(([^)]*)\)|@import""", text)
    assert addresses
    assert all((one or other).startswith(('data:', '#')) for one, other in addresses)
    assert "default-src 'none'" in text


def test_charts_are_well_formed_and_have_a_text_for_those_who_cannot_see_them(page):
    text = page.read_text(encoding='utf-8')
    charts = re.findall(r'<svg role="img" aria-label="\w+ on .*?</svg>', text, re.S)
    names = Counter(re.search(r'aria-label="(\w+) on', chart)[1] for chart in charts)
    assert names == {'curves': 3, 'reliability': 3, 'matrix': 3, 'lengths': 3}
    for chart in charts:
        xml.etree.ElementTree.fromstring(chart)
        assert 'currentColor' in chart
    assert all('alt="' in tag for tag in re.findall(r'<img [^>]*>', text))


def test_names_and_titles_are_escaped(page):
    text = page.read_text(encoding='utf-8')
    assert 'street &lt;drawn&gt; &amp; $named' in text
    assert text.count('</script>') == 2


def test_verdicts_are_those_of_the_table_and_pictures_are_held_once(page):
    pictures, rows = embedded(page)
    assert Counter(row[0] for row in rows) == VERDICTS
    assert len(pictures) == len(set(pictures)) == 3 * NUM_FRAMES - 1
    assert rows[4][6] is None and rows[5][6] is not None
    assert rows[23][1] == 'Rejected: ambiguous, and this place is not in the map.'


def test_missing_or_damaged_pictures_are_left_out(copy, tmp_path):
    (copy / 'street' / 'thumbnails' / 'query' / '000005.jpg').write_bytes(b'\xff\xd8\xff no')
    for path in (*copy.glob('*/*/scores.npy'), *copy.glob('*/*/curve.csv')):
        path.unlink()
    write_report(read_runs([copy]), tmp_path / 'page.html')
    _, rows = embedded(tmp_path / 'page.html')
    assert rows[5][5] is None
    assert 'matrix on' not in (tmp_path / 'page.html').read_text(encoding='utf-8')


def test_a_report_of_many_frames_shows_some_with_a_note(results, page, tmp_path, monkeypatch):
    monkeypatch.setattr('convseq_ros.evaluation.report.page._MOST_FRAMES', NUM_FRAMES)
    write_report(read_runs([results]), tmp_path / 'small.html')
    text = (tmp_path / 'small.html').read_text(encoding='utf-8')
    assert len(embedded(tmp_path / 'small.html')[1]) < NUM_FRAMES
    assert 'one frame in' in text and 'one frame in' not in page.read_text(encoding='utf-8')


def test_two_results_of_the_same_set_and_method_have_different_names(results, copy):
    methods = [one.name for one in read_runs([results, copy]) if one.run.set == 'loop']
    assert sorted(methods) == ['convseq', 'convseq (copy)']


def test_results_of_another_truth_are_not_shown_beside_those_of_a_set(copy):
    path = copy / 'street' / 'cohog' / 'summary.json'
    path.write_text(json.dumps(json.loads(path.read_text()) | {'truth': 'another'}))
    with pytest.raises(SourceError, match='street has another truth, or part of the map, than in'):
        read_runs([copy])


def test_truth_to_show_is_the_middle_of_the_run_nearest_to_the_match():
    right = np.isin(np.arange(20), [2, 3, 4, 10, 11, 12, 13, 14])
    assert [right_to_show(right, best) for best in (5, 19, None)] == [3, 12, 12]
    assert right_to_show(np.zeros(20, bool), 5) is None


def test_command_writes_page_and_figures_that_are_the_same_each_time(results, tmp_path):
    shutil.copytree(results / 'loop', tmp_path / 'few' / 'loop')
    found = []
    for name in ('one', 'two'):
        folder = tmp_path / name
        options = ['--output', str(tmp_path / 'report.html'), '--figures', str(folder)]
        assert main(['report', str(tmp_path / 'few'), *options]) == 0
        found.append({path.name: path.read_bytes() for path in folder.iterdir()})
    assert (tmp_path / 'report.html').exists()
    assert found[0] == found[1]
    stems = 'curves', 'reliability', 'convseq-matrix', 'convseq-lengths'
    kinds = 'png', 'svg', 'pdf'
    assert found[0].keys() == {f'loop-{stem}.{kind}' for stem in stems for kind in kinds}
    image = cv2.imdecode(np.frombuffer(found[0]['loop-curves.png'], np.uint8), cv2.IMREAD_COLOR)
    assert image.std() > 1


def one_line(captured: str) -> bool:
    return captured.startswith('convseq report: ') and captured.count('\n') == 1


@pytest.mark.parametrize(
    ('name', 'content'),
    [
        ('summary.json', '{"set": "street", '),
        ('summary.json', '[]'),
        ('summary.json', '{"accuracy_matched": "high"}'),
        ('summary.json', '{"accuracy_matched_low": NaN, "accuracy_matched_high": 1}'),
        ('summary.json', '{"frames_to_first_closure": [1]}'),
        ('summary.json', '{"configuration": {"entropy_threshold": "low"}}'),
        ('summary.json', '{"calibration": {"as_shipped": [{"said": 1}]}}'),
        ('summary.json', '[' * 100_000),
        ('frames.csv', 'query_index\n1\n'),
        ('frames.csv', ''),
        ('curve.csv', 'threshold,precision\n1,2\n'),
        ('curve.csv', 'threshold,precision,recall\n1,two,3\n'),
        ('scores.npy', 'no matrix'),
        ('scores.npy', "\x93NUMPY\x01\x00\x76\x00{'descr': '<f4', 'fortran_order': False, 'shape'"
         + ': (1000000, 1000000), }'.ljust(58) + '\n'),
        ('../truth.npy', 'no matrix'),
        ('../set.json', '[1'),
        ('../set.json', '[' * 100_000),
    ],
)  # fmt: skip
def test_damaged_file_is_named_in_one_line(copy, tmp_path, capsys, name, content):
    (copy / 'street' / 'cohog' / name).write_text(content, encoding='latin1')
    assert main(['report', str(copy), '--output', str(tmp_path / 'page.html')]) == 1
    told = capsys.readouterr().err
    assert one_line(told)
    assert re.search(r'street./?(cohog|convseq|truth\.npy)', told)
    assert not (tmp_path / 'page.html').exists()


def test_a_report_that_cannot_be_made_is_refused_in_one_line(
    copy, results, tmp_path, monkeypatch, capsys
):
    table = copy / 'street' / 'cohog' / 'frames.csv'
    table.write_text(table.read_text().replace('0.9000000', 'high', 1))
    output = ['--output', str(tmp_path / 'page.html')]
    for folder, problem in (
        (copy, 'row 4 is damaged'),
        (tmp_path / 'missing', 'missing: no results'),
        (results / 'street', 'street: no results of `convseq evaluate`'),
    ):
        assert main(['report', str(folder), *output]) == 1
        told = capsys.readouterr().err
        assert one_line(told) and problem in told
    monkeypatch.setitem(sys.modules, 'matplotlib.figure', None)
    assert main(['report', str(results), *output]) == 1
    assert capsys.readouterr().err.endswith('figures need matplotlib: pip install matplotlib\n')
    assert not (tmp_path / 'page.html').exists()


def captions(text):
    return re.findall(r'<figcaption>([^<\n]*)', text[text.index('id="pairs"') :])


def test_first_pair_is_a_right_match_and_an_address_leads_to_its_frame(page):
    assert captions(shown(page))[:2] == ['Query 3', 'Match: reference 3']
    text = shown(page, '', '#street/cohog/14')
    assert captions(text) == ['Query 14', 'Match: reference 0', 'Truth: reference 14']
    assert re.search(r'id="verdict"[^>]*class="wrong"', text)
    assert captions(shown(page, '', '#no/such/%E0%A4%A'))[0] == 'Query 3'
    last_half = shown(page, '', '#street-open/convseq/30')
    assert captions(last_half)[0] == 'Query 6' and 'only the last part' in last_half


def test_keys_buttons_and_kinds_move_from_frame_to_frame(page):
    press = "document.dispatchEvent(new KeyboardEvent('keydown', {key: 'ArrowRight'}));"
    press = press.replace('document.', 'document.body.', 1).replace("'})", "', bubbles: true})")
    assert captions(shown(page, 2 * press, '#street/convseq/3'))[0] == 'Query 5'
    kinds = "document.querySelector('#kinds [value=wrong]').click();"
    text = shown(page, kinds + 2 * "byId('next').click();", '#street/convseq/3')
    assert captions(text)[0] == 'Query 15' and '3 of 5' in text
    assert shown(page, 9 * "byId('back').click();").count('disabled') > 0


def test_page_is_no_wider_than_a_phone_or_a_desk(page):
    for width in (360, 1280):
        script = (
            f"document.body.style.width = '{width}px';"
            "document.title = document.querySelector('main').scrollWidth;"
        )
        assert int(re.search(r'<title>(\d+)', shown(page, script))[1]) <= width
