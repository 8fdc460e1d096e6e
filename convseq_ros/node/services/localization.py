# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The localisation of the robot: its state, the service `~/localize`, and the initial pose."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
import time
from typing import Any

from convseq_ros.config.node_config import NodeConfig
from convseq_ros.core.types import Localization, LocalizationState, Match, PoseEstimate
from convseq_ros.node.conversions import pose_message, status_message
from convseq_ros.node.inputs.initial_poses import InitialPoses
from convseq_ros.node.outputs.diagnostics import Situation
from convseq_ros.node.qos import advertise, LATCHED, SERVICE_QOS
from convseq_ros.node.services.worker import Turn
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from std_srvs.srv import Trigger

_MOST_CALLS = 100  # waiting at a time; each takes some 20 us per turn
_LOCALISED = LocalizationState.LOCALISED
_UNMEASURED = 'it is measured with the next match that is accepted'


@dataclass(frozen=True, slots=True)
class _State:
    """The localisation after a frame."""

    frame: int  # its number
    localization: Localization
    estimate: PoseEstimate | None  # pose of the camera at the last accepted match
    remark: str  # about that pose, or why there is none


@dataclass(eq=False)
class LocalizationTopics:
    """Publishes `~/localization` and, if wanted, `initialpose`; offers `~/localize`."""

    node: Node
    config: NodeConfig
    situation: Callable[[], Situation]  # returns the node's state
    advice: Callable[[], str]  # returns why no images may arrive
    initial_poses: InitialPoses  # those of others

    def __post_init__(self) -> None:
        self._state = _State(0, Localization(), None, _UNMEASURED)
        self._given_up = False
        self._is_pose_due = False  # from localised until a match is accepted
        self._waiting = 0  # calls
        self._publisher = advertise(self.node, DiagnosticStatus, '~/localization', LATCHED)
        self._initial_pose: Any = None
        self.configure(self.config)
        # Several calls may wait at once, while images and other services are served.
        offer = partial(self.node.create_service, callback_group=ReentrantCallbackGroup())
        offer(Trigger, '~/localize', self._on_localize, qos_profile=SERVICE_QOS)
        self._publish(Localization())

    def update(self, match: Match, estimate: PoseEstimate | None) -> None:
        """Take in the answer to a frame, with its pose if there is one."""
        now, before = match.localization or Localization(), self._state
        is_localised = now.state is _LOCALISED
        if match.accepted:
            remark = _remark(match, estimate)
        elif now.state is LocalizationState.LOST:
            estimate, remark = None, _UNMEASURED
        else:
            estimate, remark = before.estimate, before.remark
        self._state = _State(before.frame + 1, now, estimate, remark)
        is_new = now.state is not before.localization.state
        if is_new:
            self._publish(now)
        self._is_pose_due = is_localised and (is_new or self._is_pose_due)
        wanted = self.config.publish_initial_pose
        if self._is_pose_due and wanted and match.accepted:
            self._is_pose_due = False
            self._announce(match, estimate, remark)

    def configure(self, config: NodeConfig) -> None:
        """Use other settings from now on."""
        self.config = config
        if config.publish_initial_pose and not self._initial_pose:
            kind = PoseWithCovarianceStamped
            self._initial_pose = advertise(self.node, kind, 'initialpose', LATCHED)

    def give_up(self) -> None:
        self._given_up = True

    def _publish(self, now: Localization) -> None:
        level = DiagnosticStatus.OK if now.state is _LOCALISED else DiagnosticStatus.WARN
        values: dict[str, object] = {'problem': now.problem}
        if now.quality is not None:
            values['quality'] = float(now.quality)
        if now.reference_index is not None:
            values['reference_index'] = now.reference_index
        name = self.node.get_fully_qualified_name().lstrip('/')
        topic = self.situation().topic
        self._publisher.publish(status_message(level, name, now.state.value, values, topic))

    def _announce(self, match: Match, estimate: PoseEstimate | None, remark: str) -> None:
        if estimate:
            message = pose_message(match, estimate, self.config.map_frame)
            self.initial_poses.sent.append(message)
            self._initial_pose.publish(message)
        else:
            self.node.get_logger().warning(f'no initialpose: {remark}', once=True)

    async def _on_localize(
        self, _request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        """Wait for a frame that localises the robot; answer why not if none does in time."""
        begun, until_s = self._state.frame, time.monotonic() + self.config.localize_timeout_s
        self._waiting += 1
        try:
            while (answer := self._answer(begun, time.monotonic() >= until_s)) is None:
                await Turn()
        finally:
            self._waiting -= 1
        response.success, response.message = answer
        return response

    def _answer(self, begun: int, is_late: bool) -> tuple[bool, str] | None:
        """Return the answer to a call that came after frame `begun`; None to wait on."""
        state = self._state
        if problem := self._hindrance():
            return False, problem
        if state.frame > begun and state.localization.state is _LOCALISED:
            return True, self._in_words(state)
        if self._waiting > _MOST_CALLS:
            return False, f'more than {_MOST_CALLS} calls wait; {state.localization.problem}'
        if is_late and state.frame == begun:
            return False, f'no images: {self.advice()}'
        return (False, state.localization.problem) if is_late else None

    def _hindrance(self) -> str:
        """Return why waiting is useless; empty if it is not."""
        if self._given_up:
            return 'the node is ending'
        situation = self.situation()
        name = self.node.get_fully_qualified_name()
        if not situation.enabled:
            return f'disabled; call {name}/set_enabled, or activate a managed node'
        if situation.ready and not situation.map_size:
            return f'there is no map; call {name}/load_map or set map_path'
        return ''

    def _in_words(self, state: _State) -> str:
        now = state.localization
        quality = 'not known' if now.quality is None else f'{now.quality:.2f}'
        text = f'place {now.reference_index}, quality {quality}; '
        if (estimate := state.estimate) is None:
            return f'{text}no pose: {state.remark}'
        return f'{text}{estimate} in frame {self.config.map_frame}{state.remark}'


def _remark(match: Match, estimate: PoseEstimate | None) -> str:
    """Return a remark about a pose, or why there is none."""
    if estimate is None:
        return 'the map has none; build it with --odom or --poses'
    if match.relative_yaw_rad is None and match.relative_pose is None:
        return "; not calibrated: without camera_info it is the place's own"
    return ''
