# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A bridge from `~/closure` to a back end.

Usage: python bridge_node.py rtabmap|swarm_slam|kimera. Not run in the tests: it needs the
sourced message package of the back end. With `descriptor` instead of a back end, it publishes a
`GlobalDescriptor` of every image for RTAB-Map.
"""

from collections.abc import Callable
from functools import partial
from importlib import import_module
import sys
from typing import Any

from keyframes import closure_from, Keyframes, robots_of, stamp_to_ns, Waiting
import messages
import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import Header

_DEPTH = 1000
_KEYFRAME = 'cslam_common_interfaces/msg/KeyframeOdom'
Stamped = list[tuple[int, int]]  # stamps in nanoseconds and ids of keyframes


class Kinds(dict[str, Any]):
    """Message types by name, imported on first use."""

    def __missing__(self, name: str) -> Any:
        package, folder, kind = name.split('/')
        try:
            self[name] = getattr(import_module(f'{package}.{folder}'), kind)
        except ModuleNotFoundError:
            sys.exit(f'bridge: {package} is not there; source the workspace of the back end')
        return self[name]


class Bridge(Node):
    """Forwards closures as soon as the back end `name` has keyframes for both stamps."""

    def __init__(self, name: str) -> None:
        super().__init__(f'{name}_bridge')
        self._kinds = Kinds()
        self._within_s = self.declare_parameter('within_s', 0.15).value
        self._waiting = Waiting(Keyframes(self._within_s))
        # Closures with other robots, and the robot that drove each session of the map.
        self._others: dict[int, Waiting] = {}
        self._robots: dict[bytes, int] = {}
        self._robot = self.declare_parameter('robot_id', 0).value
        self._send: Callable[[int, int, Any], bool] | None = None
        self._send_to: Callable[[int, int, int, float], bool]
        self._needs_pose = name != 'swarm_slam'
        getattr(self, f'_begin_{name}')()
        self.create_subscription(PointCloud2, 'closure', self._on_closure, _DEPTH)

    def _begin_rtabmap(self) -> None:
        service = self._kinds['rtabmap_msgs/srv/AddLink']
        links = self.create_client(service, 'add_link')

        def send(query: int, reference: int, closure: Any) -> bool:
            if not links.service_is_ready():
                return False
            link = messages.rtabmap_link(self._kinds, query, reference, closure)
            links.call_async(service.Request(link=link))
            return True

        def nodes(message: Any) -> Stamped:
            return [(round(node.stamp * 1e9), node.id) for node in message.nodes]

        self._send = send
        self._learn('rtabmap_msgs/msg/MapData', 'mapData', self._waiting.keyframes, nodes)

    def _begin_swarm_slam(self) -> None:
        kind = 'cslam_common_interfaces/msg/LocalKeyframeMatch'
        matches = self._publisher(kind, 'cslam/local_keyframe_match')

        def send(query: int, reference: int, _: Any) -> bool:
            matches.publish(messages.swarm_local_match(self._kinds, query, reference))
            return True

        self._send = send
        self._learn(_KEYFRAME, 'cslam/keyframe_odom', self._waiting.keyframes, _keyframe)
        self._begin_swarm_slam_of_others()

    def _begin_swarm_slam_of_others(self) -> None:
        sessions = self.declare_parameter('sessions', ['']).value
        self._robots = robots_of(text for text in sessions if text)
        kind = 'cslam_common_interfaces/msg/InterRobotMatches'
        matches = self._publisher(kind, '/cslam/inter_robot_matches')

        def send(robot: int, query: int, reference: int, confidence: float) -> bool:
            ends = (self._robot, query), (robot, reference)
            matches.publish(messages.swarm_robot_matches(self._kinds, *ends, confidence))
            return True

        self._send_to = send
        for robot in sorted({*self._robots.values()} - {self._robot}):
            theirs = Keyframes(self._within_s)
            self._others[robot] = Waiting(self._waiting.keyframes, theirs)
            self._learn(_KEYFRAME, f'/r{robot}/cslam/keyframe_odom', theirs, _keyframe)

    def _begin_kimera(self) -> None:
        name = 'pose_graph_tools_msgs/msg/PoseGraph'
        kind, edges = self._kinds[name], self._publisher(name, 'external_closures')

        def send(query: int, reference: int, closure: Any) -> bool:
            header = Header(stamp=self.get_clock().now().to_msg())
            edge = messages.kimera_edge(
                self._kinds, header, query, reference, closure, self._robot
            )
            edges.publish(kind(header=header, edges=[edge]))
            return True

        def nodes(message: Any) -> Stamped:
            return [(stamp_to_ns(node.header.stamp), node.key) for node in message.nodes]

        self._send = send
        self._learn(name, 'pose_graph', self._waiting.keyframes, nodes)

    def _begin_descriptor(self) -> None:
        from convseq_ros.core.encoding.descriptor import describe
        from convseq_ros.core.encoding.regions import global_descriptor
        from convseq_ros.sources.images import gray_of, image_pixels

        kind = self._kinds['rtabmap_msgs/msg/GlobalDescriptor']
        descriptors = self.create_publisher(kind, 'global_descriptor', 10)

        def on_image(message: Image) -> None:
            gray = gray_of(image_pixels(message))
            vector = np.asarray(global_descriptor(describe(gray).cells))
            descriptors.publish(messages.rtabmap_descriptor(self._kinds, message.header, vector))

        best_effort = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.create_subscription(Image, 'image', on_image, best_effort)

    def _publisher(self, kind: str, topic: str) -> Any:
        return self.create_publisher(self._kinds[kind], topic, _DEPTH)

    def _learn(
        self, kind: str, topic: str, keyframes: Keyframes, read: Callable[[Any], Stamped]
    ) -> None:
        """Add the keyframes that messages tell."""

        def learn(message: Any) -> None:
            for stamp_ns, ident in read(message):
                keyframes.add(stamp_ns, ident)
            self._flush()

        self.create_subscription(self._kinds[kind], topic, learn, _DEPTH)

    def _on_closure(self, message: PointCloud2) -> None:
        closure = closure_from(message)
        robot = self._robots.get(closure.session)
        stamps_ns = closure.query_ns, closure.reference_ns
        if self._needs_pose and not closure.is_measured:
            self.get_logger().warning(
                'a closure without a pose in metres is left out; vpr_node needs camera_info and '
                'odometry',
                throttle_duration_sec=10.0,
            )
        elif robot in self._others:
            self._others[robot].add(*stamps_ns, closure.confidence)
        else:
            self._waiting.add(*stamps_ns, closure)
        self._flush()

    def _flush(self) -> None:
        if self._send:
            self._waiting.send(self._send)
        for robot, waiting in self._others.items():
            waiting.send(partial(self._send_to, robot))


def _keyframe(message: Any) -> Stamped:
    return [(stamp_to_ns(message.odom.header.stamp), message.id)]


def main() -> int:
    """Run until SIGINT."""
    names = ('rtabmap', 'swarm_slam', 'kimera', 'descriptor')
    if len(sys.argv) < 2 or sys.argv[1] not in names:
        print(f'usage: bridge_node.py {"|".join(names)} [--ros-args ...]', file=sys.stderr)
        return 1
    rclpy.init()
    try:
        rclpy.spin(Bridge(sys.argv[1]))
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except ValueError as error:
        print(f'bridge: {error}', file=sys.stderr)
        return 1
    finally:
        rclpy.try_shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main())
