# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A process that is killed while it saves a graph leaves a whole file: the old one or the new."""

from pathlib import Path
import subprocess
import sys

from convseq_ros.config.pose_graph_config import PoseGraphConfig
from convseq_ros.pose_graph.graph_file import load_graph
import pytest

SAVES = """
from pathlib import Path
import sys
from convseq_ros.config.pose_graph_config import PoseGraphConfig
from convseq_ros.pose_graph.graph import PoseGraph
from convseq_ros.pose_graph.graph_file import save_graph
import numpy as np
graph, pose = PoseGraph(PoseGraphConfig()), np.eye(4)
graph.running.session = 'first'
for step in range(2000):
    pose = pose.copy()
    pose[0, 3] = step
    graph.add_odometry((step + 1) * 10**9, pose)
while True:
    save_graph(graph, Path(sys.argv[1]), 'the map')
    print('saved', flush=True)
"""


def test_a_kill_9_while_saving_leaves_a_whole_file(tmp_path):
    path = Path(tmp_path / 'map.graph')
    command = [sys.executable, '-c', SAVES, str(path)]
    for lines in (1, 2, 3, 5):
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            for _ in range(lines):
                assert process.stdout.readline() == 'saved\n'
            process.kill()  # SIGKILL, most likely in the middle of the next one
        (drive,) = load_graph(path, PoseGraphConfig()).earlier
        assert len(drive.poses) == 2000


def test_only_solving_needs_gtsam():
    pytest.importorskip('rclpy', reason='needs ROS')
    code = 'import convseq_ros.node.vpr_node, sys; print("gtsam" in sys.modules)'
    done = subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0 and done.stdout.split()[-1] == 'False', done.stderr
