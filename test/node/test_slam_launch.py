# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Both nodes as `ros2 launch` starts them from slam.launch.py, over DDS, with TF: all is real."""

import math
import os
import re
import shutil
import signal
import subprocess

from convseq_ros.core.rigid import inverse, Matrix, matrix, pose_of
from convseq_ros.node.conversions import pose_only_message, stamp_from_ns, stamp_to_ns
from convseq_ros.sources.pose_track import pose_from_message
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Pose
from nav_msgs.msg import Odometry
import numpy as np
from pictures import walls
from poses import at
import pytest
from sensor_msgs.msg import Image
from squares import SECOND, squares
from std_msgs.msg import Header, Int32

pytest.importorskip('ros2launch', reason='launch and launch_ros come with ROS, not from PyPI')
pytest.importorskip('tf2_msgs', reason='tf2_msgs comes with ROS, not from PyPI')
pytest.importorskip('gtsam', reason='needs gtsam: pip install gtsam')

from ament_index_python.packages import get_packages_with_prefixes
from tf2_msgs.msg import TFMessage

if 'convseq_ros' not in get_packages_with_prefixes():
    pytest.skip('ros2 launch does not find convseq_ros', allow_module_level=True)

# A picture is a place, which is known at once, and a closure.
QUICK = {
    'matching': 'regional', 'search': 'exhaustive', 'fixed_length': 1, 'rival_distance': 2,
    'keyframe_overlap': 1.0, 'queue_size': 1000, 'max_wait_s': 0.0, 'odom_wait_s': 5.0,
    'closure_interval_s': 0.5, 'graph_spacing_m': 0.9, 'period_s': 0.1, 'respawn': 'true',
}  # fmt: skip
AHEAD_NS = SECOND // 10  # transform_tolerance of nav2
BEGIN_S, SIDE, LAP = 1000, 8, 32
JUMP_M, RIGHT_M = 0.2, 0.5


class Robot:
    """What is sent to both nodes, a second apart, and what they tell."""

    def __init__(self, client, image):
        self.client, self.image, self.stamp_ns, self.shown = client, image, BEGIN_S * SECOND, 0
        self.transforms, self.told = {}, {}
        self.matches = client.listen(Int32, '/vpr_node/match_index')
        client.wait_until_known_to('/pose_graph_node')  # it may be the last that starts
        listen = client.node.create_subscription
        self.heard = (
            listen(TFMessage, '/tf', self._on_tf, 100),
            listen(DiagnosticArray, '/diagnostics', self._on_diagnostics, 100),
        )
        self.odometry, self.camera = client.camera(Odometry, '/odom'), client.camera(Image)

    def _on_tf(self, message):
        for one in message.transforms:
            self.transforms[stamp_to_ns(one.header.stamp)] = one

    def _on_diagnostics(self, message):
        for status in message.status:
            if status.name == 'pose_graph_node: pose graph':
                self.told = {pair.key: pair.value for pair in status.values}
                self.told |= {'level': status.level, 'message': status.message}

    def wait_for_told(self, **wanted):
        self.client.wait_for(lambda: wanted.items() <= self.told.items(), f'{wanted}')

    def go(self, pose: Matrix, picture=None):
        """Send odometry, and what is seen there, and wait until that is recognised."""
        self.stamp_ns += SECOND
        message = Odometry(header=Header(stamp=stamp_from_ns(self.stamp_ns), frame_id='odom'))
        message.child_frame_id = 'base_link'
        message.pose.pose = pose_only_message(pose_of(pose))
        self.odometry.publish(message)
        if picture is not None:
            self.shown += 1
            self.camera.publish(self.image(picture, self.stamp_ns))
            self.client.wait_for(lambda: len(self.matches) == self.shown, 'a match')

    def correction(self, pose: Matrix) -> Matrix:
        """Return map -> odom as /tf has it for odometry of now."""
        self.go(pose)
        one = self.client.wait_for(lambda: self.transforms.get(self.stamp_ns + AHEAD_NS), '/tf')
        assert (one.header.frame_id, one.child_frame_id) == ('map', 'odom')
        where, turn = one.transform.translation, one.transform.rotation
        there = Pose(orientation=turn)
        there.position.x, there.position.y, there.position.z = where.x, where.y, where.z
        return matrix(pose_from_message(there))


def off_m(one: Matrix, other: Matrix) -> float:
    return float(np.linalg.norm((one - other)[:3, 3]))


@pytest.fixture
def launched(client, image, tmp_path):
    """Return a starter of slam.launch.py, and the pids of the nodes of a name it has started."""
    processes, log = [], tmp_path / 'launch.log'

    def start(**arguments):
        words = [f'{name}:={value}' for name, value in (QUICK | arguments).items()]
        command = [shutil.which('ros2'), 'launch', 'convseq_ros', 'slam.launch.py', *words]
        with log.open('wb') as out:
            processes.append(
                subprocess.Popen(command, stdout=out, stderr=out, start_new_session=True)
            )
        return Robot(client, image)

    def pids(name):
        found = re.findall(rf'{name}-\d+\]: process started with pid \[(\d+)\]', log.read_text())
        return [int(pid) for pid in found]

    yield start, pids
    for process in processes:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(30)
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
    print(log.read_text())


def test_a_killed_graph_is_started_again_and_the_transform_goes_on(launched, tmp_path):
    start, pids = launched
    robot = start(map_path=tmp_path / 'new.db')
    robot.wait_for_told(keyframes='0', map_to_odom_sigma_m='inf')
    drifted, pictures = squares(scale=1.03, excess_rad=0.06, side=SIDE), walls(LAP)
    for step in range(LAP + 6):
        robot.go(drifted[step], pictures[step % LAP])
    robot.wait_for_told(kept='6', refused='0', level=DiagnosticStatus.OK)
    assert 0 < float(robot.told['map_to_odom_sigma_m']) < math.inf
    before = robot.correction(drifted[step])
    assert off_m(before @ drifted[step], drifted[step]) > 3 * JUMP_M

    (pid,) = pids('pose_graph_node')
    os.kill(pid, signal.SIGKILL)
    robot.client.wait_for(lambda: len(pids('pose_graph_node')) == 2, 'a new process')
    robot.client.wait_until_known_to('/pose_graph_node')
    robot.told = {}
    after = robot.correction(drifted[step])
    assert off_m(after @ drifted[step], before @ drifted[step]) < JUMP_M
    for step in range(LAP + 6, LAP + 8):
        robot.go(drifted[step], pictures[step % LAP])
    robot.wait_for_told(kept='8', refused='0', level=DiagnosticStatus.OK)


def test_a_robot_that_was_carried_away_in_a_map_is_right_from_the_third_closure_on(
    launched, map_path, street, street_map
):
    start, _ = launched
    robot = start(map_path=map_path, mode='preloaded')
    robot.wait_for_told(map_to_odom_sigma_m='inf')
    places = [matrix(place.pose) for place in street_map.places]
    begun, carried_m = matrix(at(100.0, -20.0, 1.0)), 10

    def odometry(place):
        return inverse(begun) @ places[place]

    for place in range(6):
        robot.go(odometry(place), street[place])
    robot.wait_for_told(kept='6', refused='0', level=DiagnosticStatus.OK)
    assert float(robot.told['map_to_odom_sigma_m']) < math.inf
    pose = odometry(place)
    assert off_m(robot.correction(pose) @ pose, places[place]) < RIGHT_M
    for number, place in enumerate((6, 7, 8), 1):
        robot.correction(pose := odometry(place))  # heard before vpr_node says that it is lost
        robot.go(pose, street[place + carried_m])
        if number < 3:
            robot.wait_for_told(contradicting=str(number), level=DiagnosticStatus.WARN)
            assert off_m(robot.correction(pose) @ pose, places[place + carried_m]) > RIGHT_M
    robot.wait_for_told(carried='1', contradicting='0', level=DiagnosticStatus.OK)
    assert off_m(robot.correction(pose) @ pose, places[place + carried_m]) < RIGHT_M
