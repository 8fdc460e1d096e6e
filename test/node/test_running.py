# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How the process of a node uses memory, and where the home is read-only."""

import os
import signal
import subprocess
import sys

import cv2
import numpy as np
import pytest

SCRIPT = """
import resource
from convseq_ros.node.running import keep_memory_at_hand
keep_memory_at_hand()
for number in range(40):
    if number == 10:
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    images = [bytearray(b'x') * 921_600 for _ in range(3)]
    del images
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


def test_the_memory_of_an_image_serves_the_next():
    """Three copies of an image of 640 x 480 are 675 pages, 30 times."""
    done = subprocess.run([sys.executable, '-c', SCRIPT], capture_output=True, check=True)
    assert int(done.stdout) < 675


@pytest.mark.parametrize('module', ['vpr_node', 'player'])
def test_a_home_that_is_read_only_stops_nothing(module, map_path, tmp_path):
    picture = tmp_path / 'pictures' / '0.png'
    picture.parent.mkdir()
    cv2.imwrite(str(picture), np.full((8, 8), 99, np.uint8))
    words = {
        'vpr_node': ['--ros-args', '-p', f'map_path:={map_path}'],
        'player': [str(picture.parent), '--rate', '1000', '--wait-subscribers', '0'],
    }[module]
    given = {key: value for key, value in os.environ.items() if key != 'ROS_LOG_DIR'}
    given |= {'HOME': '/proc', 'TMPDIR': str(tmp_path), 'PYTHONPATH': os.pathsep.join(sys.path)}
    process = subprocess.Popen(
        [sys.executable, '-m', f'convseq_ros.node.{module}', *words],
        env=given,
        stderr=subprocess.PIPE,
        text=True,
    )
    with process:
        told = process.stderr.readline()
        assert told.startswith('warning: /proc/.ros/log: ') and str(tmp_path) in told
        if module == 'vpr_node':
            while 'listening to' not in process.stderr.readline():
                assert process.poll() is None
            process.send_signal(signal.SIGINT)
    assert process.returncode == 0
