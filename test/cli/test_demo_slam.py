# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Both nodes over DDS, small: vpr_node in online mode, and false closures in between."""

import math
from pathlib import Path

from convseq_ros.simulation import town
from convseq_ros.simulation.recording import write_recording
from convseq_ros.sources.recording import read_poses
import drives
import numpy as np
import pytest

pytest.importorskip('gtsam', reason='needs gtsam: pip install gtsam')
pytest.importorskip('rclpy', reason="needs ROS: pip install '.[ros]'")
pytest.importorskip('rosbags', reason='needs rosbags: pip install rosbags')

from convseq_ros.cli.demo_slam import draw_false, error_m, play, read_trajectory, VPR

SETTINGS = VPR | {'closure_interval_s': 1.0}
SECOND = 1_000_000_000


def test_closures_of_the_node_correct_the_path_and_false_ones_do_not(tmp_path):
    route, source = town.two_blocks(30.0, 24.0), Path(town.__file__).read_bytes()
    drawn = drives.kept(lambda: town.shots(route), 'simulated', source, route)
    write_recording(tmp_path / 'drive', drawn, info_topic='/camera/camera_info')
    topics = (read_poses(tmp_path / 'drive', topic) for topic in ('/ground_truth', '/odom'))
    truth, odometry = ({at_ns: pose.position for at_ns, pose in poses} for poses in topics)
    false = (min(truth) + 36 * SECOND, min(truth) + 7 * SECOND)
    assert math.dist(truth[false[0]], truth[false[1]]) > 15
    play(tmp_path, len(truth), 8.0, SETTINGS, [false])
    log = (tmp_path / 'pose_graph_node.log').read_text()
    query_s, reference_s = (stamp_ns / 1e9 for stamp_ns in false)
    assert f'closure of {query_s:.3f} with {reference_s:.3f} is refused: ' in log
    lines = (tmp_path / 'graph.g2o').read_text().splitlines()
    edges = [[int(word) for word in line.split()[1:3]] for line in lines if line[:4] == 'EDGE']
    assert sum(end - start != 1 for start, end in edges) >= 5
    after = read_trajectory(tmp_path / 'trajectory.txt')
    assert error_m(after, truth) < 0.6 * error_m(odometry, truth)


def test_false_closures_are_far_apart_in_space_and_time():
    truth = {at * SECOND: (1.0 * at, 0.0, 0.0) for at in range(100)}
    pairs = draw_false(truth, 5)
    assert len(pairs) == 5
    assert all(query_ns - reference_ns >= 30 * SECOND for query_ns, reference_ns in pairs)


def test_the_error_is_after_the_best_turn_and_shift_without_a_mirror():
    rng = np.random.default_rng(1)
    truth = {at: (*rng.uniform(0, 50, 2).tolist(), 0.0) for at in range(30)}
    cos, sin = math.cos(2.0), math.sin(2.0)
    turned = {at: (cos * x - sin * y, sin * x + cos * y) for at, (x, y, _) in truth.items()}
    moved = {at: (x + 7.0, y - 3.0, 1.0) for at, (x, y) in turned.items()}
    assert error_m(moved, truth) < 1e-9
    assert error_m({at: (x, -y, z) for at, (x, y, z) in truth.items()}, truth) > 5
    assert error_m({**moved, 99: (0.0, 0.0, 0.0)}, truth) < 1e-9  # which has no truth
