# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The demo: the main job with a real node, and folders that it refuses."""

from convseq_ros.cli import main
from convseq_ros.results import read_results
import cv2
import numpy as np
import pytest

COUNT = 12
MARKER = '.convseq-demo'


@pytest.fixture
def data(tmp_path):
    rng = np.random.default_rng(0)
    for name in ('a_query', 'b_reference'):
        folder = tmp_path / 'data' / name
        folder.mkdir(parents=True)
        for index in range(COUNT):
            place = np.random.default_rng(index).integers(0, 128, (60, 80))
            image = (place + rng.integers(0, 64, (60, 80))).astype(np.uint8)
            cv2.imwrite(str(folder / f'{index}.png'), image)
    return tmp_path / 'data'


def run(data, output, *more):
    return main(['demo', '--data', str(data), '--output', str(output), *more])


def test_two_folders_go_through_the_live_node_and_end_in_a_table_and_a_picture(
    data, tmp_path, capfd
):
    pytest.importorskip('rclpy')
    pytest.importorskip('matplotlib')
    options = '--matching regional --search exhaustive --fixed-length 2 --rival-distance 1'.split()
    earlier = tmp_path / 'out' / 'live.csv'
    earlier.parent.mkdir()
    (earlier.parent / MARKER).touch()
    earlier.write_text('of an earlier demo')
    assert run(data, tmp_path / 'out', *options, '--min-margin', '0') == 0
    assert len(read_results(earlier)) == COUNT
    lines = {line[:34].strip(): line[34:].split() for line in capfd.readouterr().out.splitlines()}
    assert lines['frames dropped'] == ['0', '0']
    assert lines['best match within +-2'] == ['11', 'of', '11'] * 2
    assert lines['accepted match within +-2'] == ['11', 'of', '11'] * 2
    assert lines['same k, index and score'] == ['12', 'of', '12']
    picture = cv2.imread(str(tmp_path / 'out' / 'demo.png'))
    assert picture.shape[1] > 1000 and picture.std() > 10


@pytest.mark.parametrize('break_it', ['one folder', 'missing', 'bad truth', 'not ours'])
def test_what_it_cannot_use_is_one_line(data, tmp_path, capsys, break_it):
    output = tmp_path / 'out'
    if break_it == 'one folder':
        (data / 'b_reference').rename(tmp_path / 'elsewhere')
        told = 'needs two drives'
    elif break_it == 'missing':
        data, told = tmp_path / 'none', 'no such folder'
    elif break_it == 'bad truth':
        (data / 'ground_truth.csv').write_text('query\n0\n')
        told = 'expected a header and the columns query, reference'
    else:
        output.mkdir()
        (output / 'precious').write_text('keep me')
        told = 'not of an earlier demo'
    assert run(data, output) == 1
    said = capsys.readouterr().err
    assert told in said and said.count('\n') == 1
    if break_it == 'not ours':
        assert (output / 'precious').read_text() == 'keep me'
