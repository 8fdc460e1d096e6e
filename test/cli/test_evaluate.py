# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The command `convseq evaluate`."""

import hashlib
import json
import re
import sys

from convseq_ros.cli import main
from convseq_ros.evaluation.report import results
from pictures import picture, written
import pytest

for name in ('jinja2', 'matplotlib', 'pandas', 'sklearn'):
    pytest.importorskip(name)

OPTIONS = ['--image-size-px', '128']


@pytest.fixture
def street(tmp_path):
    """Return the file of a data set of eight noisy images that are their own references."""
    written(tmp_path / 'images', map(picture, range(8)))
    path = tmp_path / 'street.yaml'
    path.write_text('query: {path: images}\nreference: {path: images}\ntruth: {kind: identity}\n')
    return path


def evaluate(street, *arguments):
    folder = street.parent
    places = '--output', str(folder / 'out')
    return main(['evaluate', *map(str, arguments), *places, *OPTIONS])


def test_a_table_is_printed_and_the_folder_written(street, capsys):
    kept = street.parent / 'kept'
    methods = '--method', 'cohog', '--method', 'hog', '--cache', kept
    assert evaluate(street, street, *methods) == 0
    out, err = capsys.readouterr()
    lines = out.splitlines()
    assert not err and 'R@1   R@5  R@10  R@20 ' in lines[0]
    assert lines[0].split()[:3] == ['set', 'method', 'acc.']
    cohog, hog = (line.split() for line in lines[1:])
    assert (cohog[:3], hog[:3]) == (['street', 'cohog', '1.000'], ['street', 'hog', '1.000'])
    assert cohog[7:11] == ['1.000', '1.000', '1.000', '1.000']
    assert hog[7:11] == ['+0.000', '(+0.00', 'to', '+0.00)']
    assert (street.parent / 'out' / 'summary.csv').exists()
    assert len([*kept.glob('*.npz')]) == 3  # of ours, the paper's and HOG


@pytest.mark.parametrize('name', ['report.html', 'summary.csv'])
def test_a_folder_with_a_page_or_a_table_of_somebody_else_is_refused(street, capsys, name):
    folder = street.parent / 'out'
    folder.mkdir()
    (folder / name).write_text('mine')
    assert evaluate(street, street, '--method', 'hog') == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert f'--output: {folder / name} was not written by this program, and is kept' in line
    assert [path.read_text() for path in folder.iterdir()] == ['mine']
    (folder / name).unlink()
    assert evaluate(street, street, '--method', 'hog') == 0
    assert evaluate(street, street, '--method', 'hog') == 0  # its own is replaced


def test_a_sweep_runs_and_draws_the_papers_method_with_each_value(street, monkeypatch, capsys):
    figures = []
    monkeypatch.setattr(results, 'svg', lambda figure: figures.append(figure) or '<svg/>')
    assert evaluate(street, street, '--sweep', 'k=1..3', '--json') == 0
    found = json.loads(capsys.readouterr().out)
    assert [one['method'] for one in found] == ['paper-k1', 'paper-k2', 'paper-k3']
    assert [one['mean_k'] for one in found] == [1, 2, 3]
    shares, times = figures[0].axes
    for line, key in zip(shares.lines, ('accuracy_matched', 'auc_pr'), strict=True):
        assert line.get_xydata().tolist() == [[at + 1, found[at][key]] for at in range(3)]
    expected = [[at, at * one['encode_ms']] for at, one in enumerate(found, 1)]
    assert times.lines[0].get_xydata().tolist() == expected
    assert [times.lines[0].get_label(), times.get_xlabel()] == ['paper', 'k']


def test_a_sweep_of_several_methods_keeps_their_labels(street, capsys):
    methods = '--method', 'cohog label=one', '--method', 'hog'
    assert evaluate(street, street, *methods, '--sweep', 'min_length=2..3') == 0
    names = [line.split()[1] for line in capsys.readouterr().out.splitlines()[1:]]
    assert names == [f'{name}-min_length{value}' for name in ('one', 'hog') for value in (2, 3)]


def test_an_option_that_a_method_has_twice_is_refused(street, capsys):
    assert evaluate(street, street, '--method', 'convseq k=2 k=3') == 1
    assert "method 'convseq k=2 k=3': gives an option twice" in capsys.readouterr().err


@pytest.mark.parametrize('text', ['k', 'k=1', 'k=3..2', 'k=1..x', '=1..2', 'k=0..99999'])
def test_a_sweep_without_a_range_is_refused_in_one_line(street, capsys, text):
    assert evaluate(street, street, '--sweep', text) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f'convseq evaluate: --sweep: {text!r} is no option and range; give ')


def test_one_method_is_over_no_first_one(street, capsys):
    assert evaluate(street, street, '--method', 'cohog') == 0
    assert 'over first' not in capsys.readouterr().out


def test_results_of_several_people_are_put_in_one_table(street, capsys):
    assert evaluate(street, street, '--method', 'cohog', '--method', 'hog') == 0
    files = [*(street.parent / 'out' / 'street').glob('*/summary.json')]
    one = json.loads(files[0].read_text())
    assert one['protocol_version'] == 3 and one['accuracy_all'] == 1
    assert one['images']['query'] == one['images']['reference']
    listing = ''.join(
        f'{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n'
        for path in sorted((street.parent / 'images').iterdir())
    )
    assert one['images']['query'] == hashlib.sha256(listing.encode()).hexdigest()
    table = capsys.readouterr().out
    assert main(['report', str(street.parent / 'out')]) == 0
    assert capsys.readouterr().out == table
    assert main(['report', '--latex', str(street.parent / 'out')]) == 0
    printed = capsys.readouterr().out
    assert r'P at 100 \% R' in printed and r'street & cohog & 1.000 & 1.00-1.00 & 8 &' in printed


@pytest.mark.parametrize(
    ('change', 'problem'),
    [
        ({'protocol_version': 1}, 'b.json: protocol version 1, and this program has 3'),
        ({'images': {'query': 'other'}}, 'b.json: street has other images than in the results'),
        ({'truth': 'other'}, 'b.json: street has another truth, or part of the map, than'),
        ({'criterion': 'margin'}, 'b.json: street has another criterion than in the results'),
        ({'set': None, 'images': None}, ''),
        (None, 'b.json: no summary of `convseq evaluate`'),
    ],
)
def test_figures_that_cannot_be_compared_are_refused(tmp_path, capsys, change, problem):
    own = {'set': 'street', 'method': 'a', 'protocol_version': 3, 'images': {'query': 'one'}}
    own |= {'truth': 'one', 'criterion': 'score'}
    (tmp_path / 'a.json').write_text(json.dumps(own))
    (tmp_path / 'b.json').write_text('[]' if change is None else json.dumps(own | change))
    done = main(['report', str(tmp_path / 'a.json'), str(tmp_path / 'b.json')])
    told = capsys.readouterr().err
    assert done == bool(problem) and problem in told and told.count('\n') == bool(problem)


def test_without_a_data_set_the_known_ones_are_named_in_one_line(street, capsys):
    assert evaluate(street) == 1
    (line,) = capsys.readouterr().err.splitlines()
    told = 'convseq evaluate: no data set; give a YAML file or one of alderley'
    assert line.startswith(told)


def test_a_page_of_each_set_has_table_figures_and_pairs(street):
    assert evaluate(street, street, '--method', 'cohog', '--method', 'hog') == 0
    text = (street.parent / 'out' / 'report.html').read_text('utf-8')
    assert '<td>cohog</td>' in text and text.count('class="chart"') == 3
    for method in ('cohog', 'hog'):
        assert f'<summary>{method}: right: 8</summary>' in text
    assert text.count('class="pair"') == 16 and text.count('image/jpeg') == 48
    addresses = re.findall(r'(?:src|href)="([^"]*)', text)
    assert addresses and all(one.startswith('data:') for one in addresses)


@pytest.mark.parametrize(
    ('module', 'package'),
    [('pandas', 'pandas'), ('sklearn', 'scikit-learn'), ('jinja2', 'jinja2')],
)
def test_a_missing_library_is_named_in_one_line(street, monkeypatch, capsys, module, package):
    monkeypatch.setitem(sys.modules, module, None)
    assert evaluate(street, street, '--method', 'cohog') == 1
    told = capsys.readouterr().err
    assert told.startswith(f'convseq evaluate: evaluation needs {package}: ')
    assert 'pip install' in told and told.count('\n') == 1
