# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The pose of the robot at the time of an image, by odometry."""

from collections.abc import Callable

from convseq_ros.core.types import Pose
from convseq_ros.node.inputs.listener import ListeningNode
from convseq_ros.node.inputs.missing import Missing
from convseq_ros.node.inputs.odometry_subscription import OdometrySubscription
from convseq_ros.node.inputs.waiting import Waiting
from convseq_ros.sources.mount import OdometryFrame
from convseq_ros.sources.pose_track import LONGEST_GAP_NS, PoseTrack

_DEPTH = 200  # messages of odometry that may wait
_KEPT = 20_000


class OdometryListener:
    """
    Listens to `odom`, returns the pose at the stamp of an image, and counts images without.

    An image often arrives before the odometry of its time, and waits for it: a pose interpolated
    between two messages is the same as offline, an extrapolated one is a guess. `frame` carries
    poses to the base.
    """

    def __init__(self, node: ListeningNode, wait_s: float, frame: OdometryFrame) -> None:
        self.frame_id = ''
        self.missing = Missing(node.get_logger())
        self._on_pose: Callable[[int, str], None] = lambda _stamp_ns, _frame_id: None
        self._node = node
        self._track = PoseTrack(kept=_KEPT)
        self.waiting = Waiting(wait_s)
        self._subscription = OdometrySubscription(node, frame, self._on_odometry, _DEPTH)

    def tell(self, on_pose: Callable[[int, str], None]) -> None:
        """Call `on_pose` with the stamp and the frame of each pose from now on."""
        self._on_pose = on_pose

    def pose_at(self, stamp_ns: int) -> Pose | None:
        """Return the pose at a time, for which this may wait; None if there is none."""
        with self.waiting.changed:
            if self.heard or self._node.count_publishers(self.topic):
                self.waiting.wait_until(lambda: self._has_reached(stamp_ns))
            pose = self._track.at(stamp_ns)
            last_ns = self._track.last_stamp_ns
        if last_ns is not None:
            self.missing.note(pose is None, self.topic, stamp_ns, last_ns)
        return pose

    @property
    def topic(self) -> str:
        return self._subscription.topic

    @property
    def heard(self) -> bool:
        return self._track.last_stamp_ns is not None

    @property
    def silence(self) -> str:
        """Why there is no odometry; empty if it comes, or nobody sends any."""
        if not (silent_s := self._subscription.silent_s):
            return ''
        if self.heard:
            stopped = f'odometry stopped: nothing on {self.topic} for {silent_s:.0f} s'
            return f'{stopped}; look at its publisher'
        if wrong := self._subscription.mismatch:
            return f'no odometry: {self.topic} carries {wrong}; remap it: -r odom:=TOPIC'
        return ''

    def _has_reached(self, stamp_ns: int) -> bool:
        """Return whether there is nothing more to wait for."""
        last_ns = self._track.last_stamp_ns
        return last_ns is not None and not 0 < stamp_ns - last_ns <= LONGEST_GAP_NS

    def _on_odometry(self, stamp_ns: int, pose: Pose, frame_id: str) -> None:
        with self.waiting.changed:
            self.frame_id = frame_id
            self._track.add(stamp_ns, pose)
            problem = self._track.problem
            self.waiting.notify()
        if problem:
            self._node.get_logger().warning(f'{self.topic}: {problem}', once=True)
        self._on_pose(stamp_ns, frame_id)
