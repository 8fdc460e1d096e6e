# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kills either node of slam.launch.py while a drive comes, and starts it again."""

from collections.abc import Iterator, Mapping
from contextlib import closing
from functools import partial
import heapq
import math
from pathlib import Path
import random
from statistics import median
import time
from types import SimpleNamespace
from typing import Any

from convseq_ros.cli.processes import CAMERA_INFO, IMAGE, ODOM
from convseq_ros.core.rigid import Matrix, matrix
from convseq_ros.node.conversions import stamp_to_ns
from convseq_ros.simulation import town
from convseq_ros.simulation.recording import write_recording
from convseq_ros.sources.pose_track import pose_from_message
from convseq_ros.sources.storage import open_storage
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
import numpy as np
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import CameraInfo, Image

from bench.robot import GRAPH, Robot, VPR
from bench.torture.attack import Try

WITNESS = 'witness'  # a graph that is not killed
_TOPICS: Mapping[str, tuple[str, Any]] = {
    ODOM: ('/odom', Odometry), CAMERA_INFO: ('/camera_info', CameraInfo), IMAGE: ('/image', Image),
}  # fmt: skip
_BLOCK_M = 30.0, 24.0
_DAY_S = 86_400
_RATE, _READY_S, _LAST_S, _KILLS = 1.0, 60.0, 3.0, 3
_SHARES, _DOWN_S = (0.3, 0.9), (0.0, 1.0)  # of the drive, for kills; until a start
_JUMP_M, _FOUND_M = 0.2, 5.0  # between the robot's places by both graphs
_COMPARED = 20  # transforms after a kill: 5 s


def graph_kills(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Drive through a drawn town, online and in a map, and kill a node some times on the way."""
    draw = random.Random(seed)
    drive = [*town.shots(town.two_blocks(*_BLOCK_M))]
    write_recording(folder / 'drive', drive, info_topic=CAMERA_INFO)
    for number in range(count):
        mode = ('online', 'preloaded')[number % 2]
        path = folder / f'{number - number % 2}.db'  # which the second drive finds
        yield from _drive(folder, mode, path, number * _DAY_S, draw)


class _Robot(Robot):
    """Both nodes, a graph that lives, the drive that is sent to them, and what they tell."""

    def __init__(self, folder: Path, mode: str, path: Path) -> None:
        super().__init__(folder)
        both = {'map_path': path}
        graph = both | {'graph_spacing_m': 1.0, 'period_s': 0.2, 'publish_tf': False}
        self._settings: dict[str, dict[str, Any]] = {
            VPR: both | {'mode': mode, 'closure_interval_s': 1.0, 'queue_size': 1000},
            GRAPH: graph,
            WITNESS: graph,
        }
        deep = QoSProfile(depth=1000)
        self._senders = {
            old: self.node.create_publisher(kind, new, deep)
            for old, (new, kind) in _TOPICS.items()
        }
        self._odometry = dict[int, Matrix]()  # by stamp
        self.corrections: dict[str, dict[int, Matrix]] = {GRAPH: {}, WITNESS: {}}  # by stamp
        for name in self.corrections:
            hear = partial(self._on_transform, name)
            topic = f'/{name}/map_to_odom'
            self.node.create_subscription(TransformStamped, topic, hear, deep)

    def again(self, name: str) -> None:
        """Start a node, for the first time or again."""
        self.start(name, self._settings[name])

    def kill(self, name: str) -> None:
        self.processes[name].kill()
        self.processes[name].wait()

    def send(self, topic: str, cdr: bytes, later_s: int) -> None:
        """Send a message of the recording, dated later."""
        message = deserialize_message(cdr, _TOPICS[topic][1])
        message.header.stamp.sec += later_s
        if topic == ODOM:
            at = pose_from_message(message.pose.pose)
            assert at
            self._odometry[stamp_to_ns(message.header.stamp)] = matrix(at)
        self._senders[topic].publish(message)

    def is_ready(self) -> bool:
        counts = [sender.get_subscription_count() for sender in self._senders.values()]
        return counts[0] > 2 and all(counts)

    def refused(self, name: str) -> int:
        """Return how many closures a graph refuses."""
        return int(self.told.get(name, {}).get('refused', 99))

    def apart_m(self, since_ns: int) -> list[float]:
        """Return how far apart both graphs have the robot, from a stamp on."""
        killed, witness = self.corrections[GRAPH], self.corrections[WITNESS]
        common = sorted(at for at in killed.keys() & witness.keys() if at > since_ns)
        moved = [(killed[at] - witness[at]) @ self._odometry[at] for at in common]
        return [float(np.linalg.norm(one[:3, 3])) for one in moved]

    def _on_transform(self, name: str, message: TransformStamped) -> None:
        moved = message.transform
        at = SimpleNamespace(position=moved.translation, orientation=moved.rotation)
        pose = pose_from_message(at)
        assert pose
        self.corrections[name][stamp_to_ns(message.header.stamp)] = matrix(pose)


def _drive(
    folder: Path, mode: str, path: Path, later_s: int, draw: random.Random
) -> Iterator[Try]:
    """Send the drive, and kill a node some times; yield each kill, with its problem."""
    (storage, *_), _ = open_storage(folder / 'drive')
    kept = [
        [(message.log_time_ns, topic, message.cdr) for message in storage.messages(topic)]
        for topic in _TOPICS
    ]
    sent = [*heapq.merge(*kept, key=lambda one: one[0])]
    first, last = (int(share * len(sent)) for share in _SHARES)
    kills = sorted(draw.sample(range(first, last), _KILLS))
    with closing(_Robot(folder, mode, path)) as robot:
        for name in (VPR, GRAPH, WITNESS):
            robot.again(name)
        robot.wait_for(robot.is_ready, _READY_S)
        begun_s, done = time.monotonic(), list[tuple[int, str, int]]()
        victim, until_s = '', 0.0
        for number, (time_ns, topic, cdr) in enumerate(sent):
            due_s = begun_s + (time_ns - sent[0][0]) / 1e9 / _RATE
            robot.spin(due_s - time.monotonic())
            if victim and time.monotonic() > until_s:
                robot.again(victim)
                victim = ''
            if number in kills and not victim:
                victim = draw.choice((VPR, GRAPH))
                done.append((number, victim, max(robot.corrections[GRAPH], default=0)))
                robot.kill(victim)
                until_s = time.monotonic() + draw.uniform(*_DOWN_S)
            robot.send(topic, cdr, later_s)
        robot.spin(_LAST_S)
        for number, name, stamp_ns in done:
            apart_m = robot.apart_m(stamp_ns)[:_COMPARED]
            # The median: one of both may take in a closure a moment before the other.
            middle_m = median(apart_m) if apart_m else math.inf
            # In a map that does not grow nothing is stored: two closures say where the robot is.
            allowed_m = _JUMP_M if mode == 'online' else _FOUND_M
            problem = f'{middle_m:.2f} m apart' if middle_m > allowed_m else ''
            yield Try(f'{mode}, {name} at {number} of {len(sent)}: {middle_m:.3f} m', problem)
        refused, others = robot.refused(GRAPH), robot.refused(WITNESS)
        problem = f'{refused} closures are refused for {others}' if refused > others else ''
        count = robot.told.get(GRAPH, {}).get('kept')
        yield Try(f'{mode}: {count} closures', problem)
