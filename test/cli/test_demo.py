# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The demo: the main job with a real node."""

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
