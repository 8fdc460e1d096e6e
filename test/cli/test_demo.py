# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The demo: the main job with a real node."""

from convseq_ros.cli import main
from convseq_ros.io.results import read_results
import pytest

FRAMES = 15


def test_the_demo_runs_two_drives_through_the_node_into_table_and_page(tmp_path, capfd):
    for package in ('rclpy', 'jinja2', 'matplotlib', 'rosbags'):
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
    assert (tmp_path / 'out' / 'demo.html').read_text().count('<figure>') > FRAMES
