# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The demo: the main job with a real node, and a folder that it refuses."""

from convseq_ros.cli import main
from convseq_ros.io.results import read_results
import cv2
import pytest

FRAMES = 15


def test_the_demo_runs_two_drives_through_the_node_into_table_and_picture(tmp_path, capfd):
    for package in ('rclpy', 'matplotlib', 'rosbags'):
        pytest.importorskip(package)
    earlier = tmp_path / 'out' / 'live.csv'
    earlier.parent.mkdir()
    (earlier.parent / '.convseq-demo').touch()
    earlier.write_text('of an earlier demo')
    assert main(['demo', '--frames', str(FRAMES), '--output', str(earlier.parent)]) == 0
    assert len(read_results(earlier)) == FRAMES
    lines = {line[:34].strip(): line[34:].split() for line in capfd.readouterr().out.splitlines()}
    assert lines['frames dropped'] == ['0', '0']
    assert lines['best match within +-2'] == [str(FRAMES), 'of', str(FRAMES)] * 2
    assert lines['same k, index and score'] == [str(FRAMES), 'of', str(FRAMES)]
    picture = cv2.imread(str(tmp_path / 'out' / 'demo.png'))
    assert picture.shape[1] > 1000 and picture.std() > 10


def test_a_folder_that_no_demo_made_is_left_alone(tmp_path, capsys):
    (tmp_path / 'precious').write_text('keep me')
    assert main(['demo', '--output', str(tmp_path)]) == 1
    said = capsys.readouterr().err
    assert 'not of an earlier demo' in said and said.count('\n') == 1
    assert (tmp_path / 'precious').read_text() == 'keep me'
