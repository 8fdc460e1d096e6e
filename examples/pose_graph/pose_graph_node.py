# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A back end in one node: corrects the path of odometry with loop closures.

Subscribes to `odom` (nav_msgs/Odometry) and `loop_closure` (std_msgs/Float64MultiArray, two times
in seconds). With `use_pose`, also to `pose` (geometry_msgs/PoseWithCovarianceStamped, in the frame
of the odometry). With `use_closure`, also to `closure` (sensor_msgs/PointCloud2), which has the
relative pose of a closure. Publishes `~/path_before` and `~/path_after` (nav_msgs/Path),
`~/map_to_odom` (geometry_msgs/PoseStamped, not broadcast) and /diagnostics.
"""

from dataclasses import asdict
from functools import partial
import math
from pathlib import Path
import signal
import sys
import time
from typing import Any

try:
    from graph import Closure, micro, Noise, Odometry, optimise, Pose, Solution, write_record
    import gtsam
    from incremental import Incremental
except ModuleNotFoundError as error:
    sys.exit(f'pose_graph_node: {error}; pip install gtsam')
try:
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
    from geometry_msgs.msg import Pose as PoseMessage
    from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
    from nav_msgs.msg import Odometry as OdometryMessage
    from nav_msgs.msg import Path as PathMessage
    import rclpy
    from rclpy.event_handler import QoSSubscriptionMatchedInfo, SubscriptionEventCallbacks
    from rclpy.executors import ExternalShutdownException
    from rclpy.node import Node
    from rclpy.qos import QoSProfile
    from rclpy.qos_overriding_options import QoSOverridingOptions
    from rclpy.utilities import ok, try_shutdown
    from sensor_msgs.msg import PointCloud2
    from std_msgs.msg import Float64MultiArray
except ModuleNotFoundError as error:
    sys.exit(
        f'pose_graph_node: {error}; source /opt/ros/jazzy/setup.bash, or pip install '
        'ros-jazzy-rclpy[fastrtps] ros-jazzy-common-interfaces'
    )
import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[1] / 'closures'))
from read_closure import read_closure
from read_closure import stamp_ns as stamp_of

# Deep enough that no message is lost while the graph is optimised.
_DEPTH = 1000
_TURN = ('qx', 'qy', 'qz', 'qw')
_PLANAR = (0, 1, 5)  # indices of x, y and yaw in a covariance of six


class PoseGraphNode(Node):
    """Keeps a pose graph and optimises it when there are new closures."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__('pose_graph', **kwargs)
        self._map_frame = self._declared('map_frame', 'map')
        self._result_file = self._declared('result_file', '')
        self._noise = Noise(
            **{name: self._declared(name, default) for name, default in asdict(Noise()).items()}
        )
        self._odometry = Odometry(
            self._declared('keyframe_distance_m', 2.0), self._declared('keyframe_turn_rad', 0.35)
        )
        self._pairs: list[tuple[int, int]] = []
        self._headings: dict[int, float] = {}
        self._measured: dict[tuple[int, int], tuple[Pose, tuple[float, ...]]] = {}
        self._incremental = Incremental(self._noise)
        self._closures: list[Closure] = []
        self._shown = 0
        self._solution: Solution | None = None
        self._duration_s = 0.0
        self._before = self.create_publisher(PathMessage, '~/path_before', 1)
        self._after = self.create_publisher(PathMessage, '~/path_after', 1)
        self._correction = self.create_publisher(PoseStamped, '~/map_to_odom', 1)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        subscribe = partial(self.create_subscription, qos_profile=QoSProfile(depth=_DEPTH))
        overrides = QoSOverridingOptions.with_default_policies()
        tunable = partial(subscribe, qos_overriding_options=overrides)
        matched = SubscriptionEventCallbacks(matched=self._on_matched)
        tunable(OdometryMessage, 'odom', self._on_odometry, event_callbacks=matched)
        tunable(Float64MultiArray, 'loop_closure', self._on_closure)
        if self._declared('use_pose', False):
            subscribe(PoseWithCovarianceStamped, 'pose', self._on_pose)
        if self._declared('use_closure', False):
            subscribe(PointCloud2, 'closure', self._on_measured)
        self.create_timer(self._declared('period_s', 1.0), self._work)
        self.get_logger().info('listening to odometry and closures')

    def finish(self) -> None:
        """Optimise once more with all messages, and write the result file."""
        if not len(self._odometry):
            return
        self._solve()
        if self._result_file:
            path = Path(self._result_file)
            write_record(path, self._odometry, self._closures, self._solution.kept)

    def _declared(self, name: str, default: Any) -> Any:
        return self.declare_parameter(name, default).value

    def _on_matched(self, info: QoSSubscriptionMatchedInfo) -> None:
        if info.current_count_change > 0:
            self.get_logger().info('hears odometry')

    def _on_odometry(self, message: OdometryMessage) -> None:
        pose = _pose(message.pose.pose)
        if all(map(math.isfinite, pose)):
            self._odometry.add(_stamp_ns(message), pose)

    def _on_pose(self, message: PoseWithCovarianceStamped) -> None:
        self._headings[micro(_stamp_ns(message))] = _pose(message.pose.pose).yaw

    def _on_measured(self, message: PointCloud2) -> None:
        try:
            closure = read_closure(message)
        except ValueError as error:
            self.get_logger().warning(str(error), once=True)
            return
        position, turn = [closure[name] for name in 'xy'], [closure[name] for name in _TURN]
        if not np.isfinite([*position, *turn]).all():
            return
        covariance = closure['covariance'].reshape(6, 6)
        planar = covariance[np.ix_(_PLANAR, _PLANAR)].ravel()
        pair = micro(stamp_of(closure, 'query')), micro(stamp_of(closure, 'reference'))
        self._measured[pair] = Pose(*map(float, position), _yaw(*turn)), tuple(planar.tolist())

    def _on_closure(self, message: Float64MultiArray) -> None:
        if len(message.data) != 2 or not all(map(math.isfinite, message.data)):
            self.get_logger().warning(
                f'a closure is two times in seconds; left out {list(message.data)}'
            )
            return
        query_ns, reference_ns = (round(seconds * 1e9) for seconds in message.data)
        self._pairs.append((query_ns, reference_ns))

    def _work(self) -> None:
        # A closure may arrive before the first odometry.
        if len(self._odometry) and len(self._pairs) > len(self._closures):
            self._solve()
            self._report()
        if len(self._odometry) > self._shown:
            kept = [pair[0] for pair in zip(self._closures, self._kept, strict=True) if pair[1]]
            self._incremental.update(self._odometry, kept)
            self._show()

    def _solve(self) -> None:
        begun_s = time.monotonic()
        self._closures = [
            Closure(*pair, self._turn(*pair), *self._measured.get((*map(micro, pair),), ()))
            for pair in self._pairs
        ]
        self._solution = optimise(self._odometry, self._closures, self._noise)
        self._duration_s = time.monotonic() - begun_s

    def _turn(self, query_ns: int, reference_ns: int) -> float | None:
        """Return the turn since the reference, or None if no pose gives the heading."""
        heading = self._headings.get(micro(query_ns))
        before = self._odometry.at(reference_ns)
        if heading is None or before is None:
            return None
        return math.remainder(heading - before.yaw, 2 * math.pi)

    def _show(self) -> None:
        """Publish both paths; poses after the last closure continue from its corrected end."""
        self._shown = len(self._odometry)
        before = self._odometry.keyframes
        stamps_ns = self._odometry.stamps_ns
        after = before
        if self._solution is not None:
            corrected = [Pose(*pose) for pose in self._solution.after.tolist()]
            solved = len(corrected)
            end, moved = gtsam.Pose2(*corrected[-1]), gtsam.Pose2(*before[solved - 1])
            rest = [end.compose(moved.between(gtsam.Pose2(*pose))) for pose in before[solved:]]
            after = corrected + [Pose(pose.x(), pose.y(), pose.theta()) for pose in rest]
        for publisher, poses in ((self._before, before), (self._after, after)):
            publisher.publish(self._path(stamps_ns, poses))
        self._correction.publish(self._stamped(stamps_ns[-1], self._incremental.correction))

    def _path(self, stamps_ns: list[int], poses: list[Pose]) -> PathMessage:
        path = PathMessage()
        path.header.frame_id = self._map_frame
        path.poses = [self._stamped(*pair) for pair in zip(stamps_ns, poses, strict=True)]
        path.header.stamp = path.poses[-1].header.stamp
        return path

    def _stamped(self, stamp_ns: int, pose: Pose) -> PoseStamped:
        stamped = PoseStamped()
        stamped.header.frame_id = self._map_frame
        stamped.header.stamp.sec, stamped.header.stamp.nanosec = divmod(stamp_ns, 10**9)
        stamped.pose.position.x, stamped.pose.position.y = pose.x, pose.y
        stamped.pose.orientation.z = math.sin(pose.yaw / 2)
        stamped.pose.orientation.w = math.cos(pose.yaw / 2)
        return stamped

    def _report(self) -> None:
        kept, keyframes = sum(self._kept), len(self._odometry)
        rejected = len(self._closures) - kept
        text = (
            f'closures: {kept} kept, {rejected} rejected; {keyframes} keyframes, optimised in '
            f'{self._duration_s * 1000:.0f} ms'
        )
        self.get_logger().info(text)
        values = {'kept': kept, 'rejected': rejected, 'keyframes': keyframes}
        status = DiagnosticStatus(level=DiagnosticStatus.OK, name=self.get_name(), message=text)
        status.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)

    @property
    def _kept(self) -> tuple[bool, ...]:
        return self._solution.kept if self._solution else ()


def _pose(pose: PoseMessage) -> Pose:
    at, turn = pose.position, pose.orientation
    return Pose(at.x, at.y, _yaw(turn.x, turn.y, turn.z, turn.w))


def _yaw(x: float, y: float, z: float, w: float) -> float:
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def _stamp_ns(message: Any) -> int:
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def main() -> int:
    """Run until SIGINT or SIGTERM, then optimise once more; return the exit code."""
    # As in vpr_node: rclpy's handler ends the spinning, and no exception interrupts the work.
    signal.signal(signal.SIGINT, lambda *_: None)
    rclpy.init()
    node = PoseGraphNode()
    try:
        rclpy.spin(node)
    except (ExternalShutdownException, RuntimeError):
        if ok():
            raise
    finally:
        node.finish()
        node.destroy_node()
        try_shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main())
