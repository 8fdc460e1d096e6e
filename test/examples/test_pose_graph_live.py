# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The whole example, small: over DDS, with vpr_node in online mode, and a listener as LIO-SAM."""

from contextlib import suppress
import math
import os
from pathlib import Path
import sys
import threading

from programs import run
import pytest

pytest.importorskip('gtsam', reason='needs gtsam: pip install gtsam')
pytest.importorskip('rclpy', reason="needs ROS: pip install '.[ros]'")
pytest.importorskip('rosbags', reason='needs rosbags: pip install rosbags')

from comparison import absolute_error_m
from convseq_ros.simulation.recording import write_recording
from convseq_ros.sources.recording import read_poses
import drives
from graph import Closure, Odometry, optimise, read_record
from live import play
import numpy as np
from simulated import shots, two_blocks

EXAMPLE = Path(__file__).resolve().parents[2] / 'examples' / 'pose_graph'
SIMULATED = EXAMPLE / 'simulated.py'
SETTINGS = {
    'mode': 'online', 'closure_interval_s': 1.0, 'matching': 'coherent',
    'search': 'shortlist', 'queue_size': 1000, 'max_wait_s': 0.0, 'odom_wait_s': 2.0,
}  # fmt: skip
SECOND = 1_000_000_000


class Listener:
    """Hears loop closures as LIO-SAM does: best effort, depth 1."""

    def __init__(self) -> None:
        from rclpy.context import Context
        from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
        from rclpy.node import Node
        from rclpy.qos import QoSProfile, ReliabilityPolicy
        from std_msgs.msg import Float64MultiArray

        self.heard: list[tuple[float, ...]] = []
        self._context = Context()
        self._context.init()
        self._node = Node('lio_sam', context=self._context)
        self._node.create_subscription(
            Float64MultiArray,
            '/vpr_node/loop_closure',
            lambda message: self.heard.append(tuple(message.data)),
            QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT),
        )
        executor = SingleThreadedExecutor(context=self._context)
        executor.add_node(self._node)

        def spin() -> None:
            with suppress(ExternalShutdownException):
                while self._context.ok():
                    executor.spin_once(timeout_sec=0.2)
            executor.shutdown()

        self._thread = threading.Thread(target=spin)
        self._thread.start()

    def stop(self) -> None:
        """Leave the graph."""
        self._context.try_shutdown()
        self._thread.join()
        self._node.destroy_node()


def test_closures_of_the_node_correct_the_path_and_false_ones_do_not(tmp_path):
    route = two_blocks(30.0, 24.0)
    drawn = drives.kept(lambda: shots(route), 'simulated', SIMULATED.read_bytes(), route)
    write_recording(tmp_path / 'drive', drawn, info_topic='/camera/camera_info')
    truth = {
        stamp_ns: pose.position[:2]
        for stamp_ns, pose in read_poses(tmp_path / 'drive', '/ground_truth')
    }
    first_ns = min(truth)
    false = [Closure(first_ns + 36 * SECOND, first_ns + 7 * SECOND)]
    assert math.dist(truth[false[0].query_ns], truth[false[0].reference_ns]) > 15
    listener = Listener()
    try:
        play(tmp_path, len(truth), 8.0, SETTINGS, false)
    finally:
        listener.stop()

    stamped, closures, kept = read_record(tmp_path / 'pose_graph.json')
    assert [stamp_ns for stamp_ns, _ in stamped] == sorted(truth)
    wrong = [abs(closure.query_ns - false[0].query_ns) < 1000 for closure in closures]
    assert sum(wrong) == 1
    assert not kept[wrong.index(True)]
    assert sum(kept) >= 5
    for closure in closures:
        assert closure.query_ns - closure.reference_ns >= 12 * SECOND
    told = {tuple(round(stamp_ns / 1000) for stamp_ns in closure[:2]) for closure in closures}
    heard = {tuple(round(seconds * 1e6) for seconds in pair) for pair in listener.heard}
    assert all(len(pair) == 2 for pair in listener.heard)
    assert heard <= told and len(heard) >= 0.8 * len(told)

    odometry = Odometry()
    for stamp_ns, pose in stamped:
        odometry.add(stamp_ns, pose)
    solution = optimise(odometry, closures)
    real = np.array([truth[stamp_ns] for stamp_ns in solution.stamps_ns.tolist()])
    before, after = (absolute_error_m(p[:, :2], real) for p in (solution.before, solution.after))
    assert after < 0.6 * before


@pytest.mark.parametrize('script', ['demo.py', 'pose_graph_node.py'])
@pytest.mark.parametrize('missing', ['gtsam', 'rclpy'])
def test_what_is_missing_is_one_line_that_says_how_to_get_it(tmp_path, script, missing):
    (tmp_path / f'{missing}.py').write_text(
        f'raise ModuleNotFoundError("No module named {missing!r}", name={missing!r})\n'
    )
    result = run(
        sys.executable,
        EXAMPLE / script,
        env=os.environ | {'PYTHONPATH': os.pathsep.join([str(tmp_path), *sys.path])},
    )
    assert result.returncode == 1
    assert missing in result.stderr and 'pip install' in result.stderr
    assert result.stderr.count('\n') == 1
