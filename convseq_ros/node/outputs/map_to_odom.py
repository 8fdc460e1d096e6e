# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The transform from the map to odometry, as REP-105 has it: on a topic, and on TF."""

from collections import deque
from typing import Any

from convseq_ros.core.rigid import Matrix, pose_of
from convseq_ros.node.conversions import stamp_from_ns, stamp_to_ns
from convseq_ros.node.qos import advertise
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import Header

_PERIOD_NS = 50_000_000  # at most 20 Hz
_AHEAD_NS = 100_000_000  # on TF, as nav2's transform_tolerance: until the next one comes, it holds
_REMEMBERED = 200  # stamps of our own transforms, as they come back on /tf
_DEPTH = 100


class MapToOdom:
    """
    Publishes `~/map_to_odom`, and broadcasts it if wanted and tf2_msgs is installed.

    A transform may have one publisher only: if another one is heard, this one stops, for ever.
    """

    def __init__(self, node: Node, map_frame: str, is_broadcast: bool) -> None:
        self._node, self._map_frame = node, map_frame.lstrip('/')
        self._topic = advertise(node, TransformStamped, '~/map_to_odom')
        self._sent: deque[int] = deque(maxlen=_REMEMBERED)
        self._tf: Any = None
        self.stamp_ns = 0  # of the last transform
        self.odom_frame = ''
        self._other = self._frame = ''  # why it is not broadcast: ever again, or now
        if is_broadcast:
            try:
                from tf2_msgs.msg import TFMessage
            except ImportError:
                node.get_logger().info(
                    'tf2_msgs is not installed: map -> odom is on ~/map_to_odom and not on /tf; '
                    'apt install ros-jazzy-tf2-msgs'
                )
                return
            self._kind = TFMessage
            self._tf = advertise(node, TFMessage, '/tf', _DEPTH)
            node.create_subscription(TFMessage, '/tf', self._on_tf, QoSProfile(depth=_DEPTH))

    def publish(self, stamp_ns: int, odom_frame: str, pose: Matrix) -> None:
        """Publish the pose (4, 4) of the frame of odometry in the map, at a time of odometry."""
        if 0 <= stamp_ns - self.stamp_ns < _PERIOD_NS:
            return
        odom_frame = odom_frame.lstrip('/')  # of ROS 1; TF 2 has none
        self._frame = ''
        if not odom_frame or odom_frame == self._map_frame:
            why = f'odometry is in frame {odom_frame!r}; set another one, such as odom'
            self._frame = f'map -> odom is not published: {why}'
            self._node.get_logger().error(self._frame, once=True)
            return
        self.stamp_ns, self.odom_frame = stamp_ns, odom_frame
        message = transform_message(stamp_ns, self._map_frame, odom_frame, pose)
        self._topic.publish(message)
        if self._tf and not self._other:
            ahead_ns = stamp_ns + _AHEAD_NS
            self._sent.append(ahead_ns)
            ahead = transform_message(ahead_ns, self._map_frame, odom_frame, pose)
            self._tf.publish(self._kind(transforms=[ahead]))

    def _on_tf(self, message: Any) -> None:
        for one in message.transforms:
            # Only one parent is allowed, whatever its name is.
            if one.child_frame_id.lstrip('/') == self.odom_frame and self.odom_frame:
                if stamp_to_ns(one.header.stamp) not in self._sent:
                    self._other = (
                        f'map -> odom is not broadcast: {one.header.frame_id} -> '
                        f'{self.odom_frame} is on /tf already; end its other publisher, or set '
                        'publish_tf: false'
                    )
                    self._node.get_logger().error(self._other, once=True)

    @property
    def problem(self) -> str:
        """Why it is not published, or not broadcast although it is wanted."""
        return self._other or self._frame


def transform_message(
    stamp_ns: int, frame_id: str, child_frame_id: str, moved: Matrix
) -> TransformStamped:
    """Return a transform, the pose (4, 4) of the child frame."""
    pose = pose_of(moved)
    x, y, z, w = pose.orientation
    at = Vector3(**dict(zip('xyz', pose.position, strict=True)))
    return TransformStamped(
        header=Header(stamp=stamp_from_ns(stamp_ns), frame_id=frame_id),
        child_frame_id=child_frame_id,
        transform=Transform(translation=at, rotation=Quaternion(x=x, y=y, z=z, w=w)),
    )
