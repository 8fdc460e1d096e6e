# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The pose of the robot at the time of an image, by odometry."""

from collections.abc import Callable
from threading import Condition

from convseq_ros.core.types import Pose
from convseq_ros.node.inputs.listener import ListeningNode
from convseq_ros.node.inputs.odometry_subscription import OdometrySubscription
from convseq_ros.sources.mount import OdometryFrame
from convseq_ros.sources.pose_track import AxesCheck, LONGEST_GAP_NS, PoseTrack

_DEPTH = 200  # messages of odometry that may wait
_KEPT = 20_000
_VAIN_WAITS = 3  # after which images wait no more, until odometry comes
_MANY = 20  # images in a row without a pose that are worth a warning
_CLIMBED_M = 20.0  # along z, and no less than otherwise, that a robot does not drive


class OdometryListener:
    """
    Listens to `odom`, returns the pose at the stamp of an image, and counts those `without_pose`.

    An image often arrives before the odometry of its time, and waits for it, at most `wait_s`: a
    pose interpolated between two messages is the same as offline, an extrapolated one is a guess.
    `frame` carries poses to the base.
    """

    def __init__(self, node: ListeningNode, wait_s: float, frame: OdometryFrame) -> None:
        self.frame_id, self.wait_s, self.without_pose = '', wait_s, 0
        self._changed, self._in_vain, self._in_a_row = Condition(), 0, 0
        self._on_pose: Callable[[int, str], None] = lambda _stamp_ns, _frame_id: None
        self._node = node
        self._track, self._axes = PoseTrack(kept=_KEPT), AxesCheck()
        self._subscription = OdometrySubscription(node, frame, self._on_odometry, _DEPTH)

    def tell(self, on_pose: Callable[[int, str], None]) -> None:
        """Call `on_pose` with the stamp and the frame of each pose from now on."""
        self._on_pose = on_pose

    def pose_at(self, stamp_ns: int) -> Pose | None:
        """Return the pose at a time, for which this may wait; None if there is none."""
        with self._changed:
            if self.heard or self._node.count_publishers(self.topic):
                self._wait_for(stamp_ns)
            pose = self._track.at(stamp_ns)
            last_ns = self._track.last_stamp_ns
        if last_ns is not None:
            self._count(pose is None, (last_ns - stamp_ns) / 1e9)
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

    def _wait_for(self, stamp_ns: int) -> None:
        """Wait until odometry has reached a time, unless images have waited in vain."""
        if self._in_vain < _VAIN_WAITS:
            has_come = self._changed.wait_for(lambda: self._has_reached(stamp_ns), self.wait_s)
            self._in_vain += not has_come

    def _count(self, is_missing: bool, ahead_s: float) -> None:
        """Take in the next image, and how far odometry was ahead of it."""
        self.without_pose += is_missing
        self._in_a_row = self._in_a_row + 1 if is_missing else 0
        if self._in_a_row >= _MANY:
            self._node.get_logger().warning(
                f'{self.topic}: has no pose at the time of the images; its newest stamp is '
                f'{abs(ahead_s):.1f} s {"later" if ahead_s > 0 else "earlier"}; check that it '
                'comes and that both clocks agree',
                once=True,
            )

    def _has_reached(self, stamp_ns: int) -> bool:
        """Return whether there is nothing more to wait for."""
        last_ns = self._track.last_stamp_ns
        return last_ns is not None and not 0 < stamp_ns - last_ns <= LONGEST_GAP_NS

    def _on_odometry(self, stamp_ns: int, pose: Pose, frame_id: str) -> None:
        with self._changed:
            self.frame_id, self._in_vain = frame_id, 0
            self._track.add(stamp_ns, pose)
            problem = self._track.problem
            self._changed.notify()
        if problem:
            self._node.get_logger().warning(f'{self.topic}: {problem}', once=True)
        self._axes.add(pose)
        if line := self._axes.problem(_CLIMBED_M):
            remedy = f'{line}; publish those of the base, x ahead'
            self._node.get_logger().warning(f'{self.topic}: {remedy}', once=True)
        self._on_pose(stamp_ns, frame_id)
