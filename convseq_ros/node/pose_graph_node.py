# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A back end: corrects odometry with closures, and publishes the transform map -> odom."""

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from threading import Lock, Thread
import time
from typing import Any

from convseq_ros.config.pose_graph_config import PoseGraphConfig
from convseq_ros.core.map.reader import map_id_of, open_map
from convseq_ros.core.rigid import Matrix, matrix, pose_of
from convseq_ros.core.types import LocalizationState, Pose
from convseq_ros.errors import ConvseqError, one_line, with_traceback
from convseq_ros.io.output_file import OutputFile, refuse_outputs, TEXT
from convseq_ros.io.regular_file import write_lines
from convseq_ros.node.conversions import path_message, stamp_to_ns, status_message
from convseq_ros.node.inputs.backlog import Backlog
from convseq_ros.node.inputs.camera_mount import Mount
from convseq_ros.node.inputs.closures_heard import closure_of, closure_of_pair, uncertain_pose
from convseq_ros.node.inputs.following_subscription import FollowingSubscription
from convseq_ros.node.inputs.listener import ListeningNode
from convseq_ros.node.inputs.odometry_subscription import OdometrySubscription
from convseq_ros.node.outputs.map_to_odom import MapToOdom
from convseq_ros.node.qos import advertise, LATCHED, SERVICE_QOS, steady_timer
from convseq_ros.node.running import leave, run_until_signal
from convseq_ros.node.services.parameters import declare_group
from convseq_ros.pose_graph.closures import Known
from convseq_ros.pose_graph.graph import PoseGraph
from convseq_ros.pose_graph.lines import beside, tum, write_g2o
from convseq_ros.pose_graph.optimisation import need_gtsam
from convseq_ros.pose_graph.output import trajectory, whole
from convseq_ros.pose_graph.problem import Problem
from convseq_ros.pose_graph.stored import graph_of
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from nav_msgs.msg import Path as PathMessage
import numpy as np
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger

_DEPTH = 1000
_CLOSURES = 'vpr_node/closure_odometry'
_WAIT_S = 2.0  # at the end, for a solution that is being computed
_PERIOD_S = 1.0  # of diagnostics, and of the path
_MOST_POSES = 5000  # of the path
_WRITTEN_S, _POLL_S = 1.0, 0.1  # after which vpr_node has written what it heard, and twice that


class PoseGraphNode(ListeningNode):
    """
    Collects in the listener's thread, publishes in the executor's, and solves in a third.

    ConvseqError if a parameter is not allowed, GTSAM is not installed, or the map is damaged.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(
            'pose_graph_node', automatically_declare_parameters_from_overrides=True, **kwargs
        )
        try:
            self._open(declare_group(self, PoseGraphConfig))
        except (ConvseqError, OSError):
            super().destroy_node()
            raise

    def _open(self, config: PoseGraphConfig) -> None:
        need_gtsam()
        self._config = config
        _refuse_files(config)
        self._graph = PoseGraph(config)
        self._lock, self._solving = Lock(), Lock()
        self._map_id = self._read_id = self._problem = ''
        self._unsolved = ''  # why the newest solution failed
        path = Path(config.map_path)
        if config.map_path and path.exists() and path.stat().st_size:
            self._read_id = map_id_of(path)
        self._backlog = Backlog(self.get_logger(), bool(self._read_id))
        self._thread: Thread | None = None
        self._update_ms = self._solve_ms = 0.0
        self._breaks = set[int]()  # stamps at which odometry was loosened
        self._is_closed = self._is_localised = False
        self._transform = MapToOdom(self, config.map_frame, config.publish_tf)
        self._path = advertise(self, PathMessage, '~/path')
        self._diagnostics = advertise(self, DiagnosticArray, '/diagnostics')

        before = self._backlog.before
        frame = Mount(self, config.base_frame).odometry_frame()
        self._odometry = OdometrySubscription(
            self, frame, before(self._on_odometry, matters=True), _DEPTH
        )
        for kind, topic, call in (
            (Odometry, _CLOSURES, self._on_closure),
            (Float64MultiArray, 'vpr_node/loop_closure', self._on_pair),
            (PoseWithCovarianceStamped, 'vpr_node/pose', self._on_pose),
        ):
            FollowingSubscription(self, kind, topic, before(call), _DEPTH)
        for kind, topic, call in (
            (DiagnosticArray, 'vpr_node/map_info', self._on_map),
            (DiagnosticStatus, 'vpr_node/localization', self._on_localization),
        ):
            self.create_subscription(kind, topic, before(call), LATCHED)
        self.create_service(Trigger, '~/save', self._on_save, qos_profile=SERVICE_QOS)
        if self._backlog.is_waiting:
            self._catching_up = steady_timer(self, _POLL_S, self._catch_up)
        steady_timer(self, config.period_s, self._work)
        steady_timer(self, _PERIOD_S, self._report)
        topics = self._odometry.topic, self.resolve_topic_name(_CLOSURES)
        self.get_logger().info('listening to {} and {}'.format(*topics))

    def destroy_node(self) -> None:
        """Take in the last closures if that is quick, write the files, and leave the graph."""
        if not self._is_closed:
            self._is_closed = True
            if self._thread:
                self._thread.join(_WAIT_S)
            if self._solve_ms < 1000 * _WAIT_S and self._solving.acquire(blocking=False):
                with self._lock:
                    problem = self._graph.problem()
                self._solve(problem)
            try:
                if text := self._save():
                    self.get_logger().info(text)
            except (ConvseqError, OSError) as error:
                self.get_logger().error(one_line(error))
        super().destroy_node()

    def _catch_up(self) -> None:
        """Read the map, in another thread, when it has what was driven before this started."""
        since_s = self._backlog.since_s
        waits = not since_s or time.monotonic() - since_s < _WRITTEN_S
        if waits or not self._solving.acquire(blocking=False):
            return
        self._catching_up.cancel()
        self._thread = Thread(target=self._read_map, name='map')
        self._thread.start()

    def _read_map(self) -> None:
        """Begin with the graph of the map, and take in what was heard; `_solving` is released."""
        start_s, path = time.perf_counter(), self._config.map_path
        try:
            self._graph = graph_of(open_map(path), self._config)
            count = sum(len(drive.keyframes) for drive in self._graph.drives)
            self.get_logger().info(
                f'{path}: {count} keyframes and {self._graph.counts["kept"]} closures of its '
                f'drives, read in {time.perf_counter() - start_s:.1f} s'
            )
        except Exception as error:
            self._graph = PoseGraph(self._config, in_map=True)
            self._problem = f'the map is not read: {with_traceback(error)}'
            self.get_logger().error(self._problem)
        self._backlog.take_in()
        self._solving.release()

    def _on_odometry(self, stamp_ns: int, pose: Pose, frame_id: str) -> None:
        told = pose.variances or (0.0, 0.0)
        if not np.isfinite(told).all():  # PoseGraph then takes the parameters
            self.get_logger().warning(
                f'{self._odometry.topic}: a covariance of {told[0]:g} m2 and {told[1]:g} rad2 is '
                'left out, odometry_sigma_m and odometry_sigma_rad count; look at its publisher',
                once=True,
            )
        start_s = time.perf_counter()
        with self._lock:
            restarts, resets = self._graph.restarts, self._graph.running.resets
            self._graph.add_odometry(stamp_ns, matrix(pose), told)
            correction = self._graph.correction
            anew = self._graph.restarts > restarts
            is_reset = self._graph.running.resets > resets
        self._update_ms = 1000 * (time.perf_counter() - start_s)
        if anew:
            self.get_logger().warning('the clock was set back: this drive begins a new graph')
        elif is_reset:
            self.get_logger().warning('odometry was reset: only closures tell how far it moved')
        if correction is not None:
            self._transform.publish(stamp_ns, frame_id, correction)

    def _on_closure(self, message: Any) -> None:
        if (found := closure_of(message, self._config.closure_sigma_rad)) is None:
            names = f'{message.header.frame_id!r}, {message.child_frame_id!r}'
            self._leave_out(
                f'{_CLOSURES}: {names} are not two places, session/stamp_ns, with a pose'
            )
            return
        own, closure = found
        with self._lock:
            if own:
                self._graph.name_session(own)
            self._graph.add_closure(closure)

    def _on_pair(self, message: Any) -> None:
        if (closure := closure_of_pair(message, self._config.closure_sigma_rad)) is None:
            self._leave_out(f'loop_closure: {[*message.data]} is not two times in seconds')
            return
        with self._lock:
            self._graph.add_closure(closure)

    def _on_pose(self, message: Any) -> None:
        if found := uncertain_pose(message):
            with self._lock:
                self._graph.add_pose(stamp_to_ns(message.header.stamp), *found)

    def _on_map(self, message: Any) -> None:
        """Learn which map it is, and which of its sessions this drive makes."""
        values = {pair.key: pair.value for pair in message.status[0].values}
        self._map_id = values['map_id']
        with self._lock:
            if self._read_id and self._read_id != self._map_id:
                self._problem = (
                    f'map_path: {self._config.map_path} is not the map that vpr_node uses; give '
                    'both the same, and start again'
                )
                self.get_logger().error(self._problem)
                self._graph = PoseGraph(self._config, in_map=True)
                self._read_id = ''
            with suppress(ValueError):
                stamp_ns = int(values['last_stamp_ns'])
                if self._graph.running.at(stamp_ns) is not None:
                    self._graph.name_session(values['session_ids'].split()[-1])

    def _on_localization(self, message: Any) -> None:
        """Take note that the robot is lost, as one is that was carried away."""
        was, self._is_localised = (
            self._is_localised,
            message.message == LocalizationState.LOCALISED,
        )
        if was and not self._is_localised:
            with self._lock:
                self._graph.lose()

    def _leave_out(self, what: str) -> None:
        self.get_logger().warning(f'{what}; it is left out', once=True)

    def _work(self) -> None:
        """Solve what is new in another thread."""
        if not self._solving.acquire(blocking=False):
            return
        with self._lock:
            problem = self._graph.problem()
        self._thread = Thread(target=self._solve, args=(problem,), name='solver')
        self._thread.start()

    def _solve(self, problem: Problem | None) -> None:
        """Solve and adopt; `_solving` is held, and released."""
        try:
            if problem is None:
                return
            start_s = time.perf_counter()
            solution = problem.solve()
            self._solve_ms = 1000 * (time.perf_counter() - start_s)
            with self._lock:
                changed = self._graph.adopt(problem, solution)
                breaks = {self._graph.running.keyframe_ns(at) for at in self._graph.running.breaks}
            for stamp_ns in sorted(breaks - self._breaks):
                self.get_logger().warning(
                    f'closures agree with each other and contradict odometry at '
                    f'{stamp_ns / 1e9:.3f}: the robot was carried away or slipped; odometry is '
                    'loosened there'
                )
            self._breaks, self._unsolved = breaks, ''
            for one in changed:
                self._tell(one)
        except Exception as error:
            self._unsolved = f'the graph is not solved: {with_traceback(error)}'
            self.get_logger().error(self._unsolved)
        finally:
            self._solving.release()

    def _tell(self, one: Known) -> None:
        query_s, reference_s = one.closure.query_ns / 1e9, one.closure.reference_ns / 1e9
        verdict = 'accepted after all' if one.kept else 'refused'
        self.get_logger().warning(
            f'closure of {query_s:.3f} with {reference_s:.3f} is {verdict}: {one.apart_m:.1f} m '
            f'off, {one.error:.1f} standard deviations'
        )

    def _report(self) -> None:
        with self._lock:
            values = self._graph.counts
            is_shown = self._path.get_subscription_count() and values['keyframes']
            corrected = trajectory(self._graph, _MOST_POSES) if is_shown else []
        if corrected:
            self._path.publish(path_message(_posed(corrected), self._config.map_frame))
        level, text = self._state(values)
        values |= {'solve_ms': self._solve_ms, 'update_ms': self._update_ms}
        values |= {'odom': self._odometry.topic, 'map_path': self._config.map_path}
        name = f'{self.get_fully_qualified_name().lstrip("/")}: pose graph'
        message = DiagnosticArray(status=[status_message(level, name, text, values, self._map_id)])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)

    def _state(self, values: dict[str, Any]) -> tuple[bytes, str]:
        if problem := self._problem or self._unsolved or self._transform.problem:
            return DiagnosticStatus.ERROR, problem
        if self._backlog.since_s:
            return DiagnosticStatus.WARN, 'the map is read'
        if not values['keyframes']:
            return DiagnosticStatus.WARN, f'no odometry on {self._odometry.topic}'
        text = '{keyframes} keyframes; closures: {kept} kept, {refused} refused'.format(**values)
        if apart_ns := self._graph.apart_ns:
            query_s, odometry_s = (stamp_ns / 1e9 for stamp_ns in apart_ns)
            line = (
                f'a closure is of {query_s:.3f}, when odometry, at {odometry_s:.3f}, was not: '
                'stamp camera and odometry by one clock'
            )
            self.get_logger().warning(line, once=True)
            return DiagnosticStatus.WARN, f'{text}; {line}'
        if count := values['contradicting']:
            return DiagnosticStatus.WARN, (
                f'{text}; the newest {count} contradict odometry: if the robot was carried away, '
                'map -> odom is wrong until three agree'
            )
        return DiagnosticStatus.OK, text

    def _on_save(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            written = self._save()
            nothing = 'nothing to write: tum_file and g2o_file are empty, or no odometry came'
            response.success, response.message = bool(written), written or nothing
        except (ConvseqError, OSError) as error:
            response.message = str(error)
        return response

    def _save(self) -> str:
        """Write the files that are wanted, and return their names; OSError if one fails."""
        names = ('tum_file', 'g2o_file')  # which may be set at run time
        chosen = {name: self.get_parameter(name).value for name in names}
        config, written = replace(self._config, **chosen), []
        _refuse_files(config)
        with self._lock:
            (poses, edges, stamps_ns), corrected = whole(self._graph), trajectory(self._graph)
        if config.tum_file and poses:
            write_lines(Path(config.tum_file), tum(_posed(corrected)))
            written.append(config.tum_file)
        if config.g2o_file and poses:
            write_g2o(Path(config.g2o_file), poses, edges, stamps_ns)
            written += [config.g2o_file, str(beside(Path(config.g2o_file)))]
        return ', '.join(written) and f'written: {", ".join(written)}'


def _refuse_files(config: PoseGraphConfig) -> None:
    """Raise a ConfigError for a file that cannot be written, or is not ours to replace."""
    files = [('tum_file', config.tum_file), ('g2o_file', config.g2o_file)]
    if config.g2o_file:
        files.append(('g2o_file', str(beside(Path(config.g2o_file)))))
    refuse_outputs(OutputFile(name, Path(path), TEXT) for name, path in files if path)


def _posed(trajectory: list[tuple[int, Matrix]]) -> list[tuple[int, Pose]]:
    return [(stamp_ns, pose_of(at)) for stamp_ns, at in trajectory]


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM; return the exit code."""
    return run_until_signal(PoseGraphNode, args, 'pose_graph_node')


if __name__ == '__main__':
    leave(main())
