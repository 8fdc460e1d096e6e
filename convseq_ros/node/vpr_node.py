# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The ROS node: images in, recognised places out."""

from contextlib import ExitStack
from functools import partial
import gc
from pathlib import Path
import time
from typing import Any

from convseq_ros.app.pipeline import Pipeline
from convseq_ros.config import Config
from convseq_ros.config.node_config import NodeConfig
from convseq_ros.core.encoding.mask import masked
from convseq_ros.core.types import PoseEstimate
from convseq_ros.errors import ConvseqError, one_line
from convseq_ros.io.mask_file import read_mask
from convseq_ros.io.output_file import OutputFile
from convseq_ros.models.onnx_model import open_model
from convseq_ros.node.inputs.frame_context import FrameContext
from convseq_ros.node.inputs.image_subscription import image_subscriptions, QUEUE_BYTES
from convseq_ros.node.inputs.initial_poses import InitialPoses
from convseq_ros.node.inputs.stamps import Stamps
from convseq_ros.node.outputs.counters import Counters
from convseq_ros.node.outputs.diagnostics import Diagnostics, Situation
from convseq_ros.node.outputs.measured_transform import MeasuredTransform
from convseq_ros.node.outputs.progress_log import ProgressLog
from convseq_ros.node.outputs.publishers import Answered, MatchPublishers
from convseq_ros.node.outputs.result_log import ResultLog
from convseq_ros.node.qos import SERVICE_QOS
from convseq_ros.node.running import leave, run_until_signal
from convseq_ros.node.services.life_cycle import ManagedNode, PATIENCE_S
from convseq_ros.node.services.localization import LocalizationTopics
from convseq_ros.node.services.map_services import MapServices
from convseq_ros.node.services.parameters import declare
from convseq_ros.node.services.recognition import Arrival, Recognition
from convseq_ros.node.services.worker import Worker
from convseq_ros.sources.raw_message import RawMessage
from std_srvs.srv import SetBool, Trigger

_STOP_TIMEOUT_S = 1.0  # when the process ends


class VprNode(ManagedNode):
    """
    Recognises the places of a map in the images of a camera.

    The listener's thread only queues images, the executor's thread serves services and parameters,
    and a worker's thread processes the images. ConvseqError if a parameter is not allowed, or the
    map or the result file cannot be opened.
    """

    def __init__(self, **kwargs: Any) -> None:
        try:
            super().__init__(
                'vpr_node', automatically_declare_parameters_from_overrides=True, **kwargs
            )
        except RuntimeError as error:
            # For example, security that the middleware does not support.
            raise ConvseqError(str(error)) from None
        self._enabled = True
        self._is_open = self._ready = self._listening = False
        try:
            self._config, self._node_config = declare(self, self._on_parameters)
            self._is_managed = self._node_config.lifecycle
            if self._is_managed:
                self.manage()
            else:
                self.open_work()
        except BaseException:
            super().destroy_node()
            raise

    def open_work(self) -> None:
        """Open the map and the result file, make the parts of the node, and warm up."""
        with ExitStack() as opened:
            self._open_work(opened)
            opened.pop_all()
        self._is_open = True
        self._worker.between_items(self._warm_up)
        self._worker.start()

    def _open_work(self, opened: ExitStack) -> None:
        logger, config = self.get_logger(), self._node_config
        self._images = image_subscriptions(self, config, self._on_image)
        self._chosen = [it.topic for it in self._images] if config.image_topics else []
        if config.result_file:
            result = OutputFile('result_file', Path(config.result_file))
            result.refuse(Path(path) for path in (config.map_path, config.save_map_path) if path)
        pipeline = self._open_pipeline(Path(config.map_path) if config.map_path else None)
        opened.callback(pipeline.close)
        self._results = ResultLog(config.result_file, logger)
        opened.callback(self._results.close)
        for line in pipeline.ignored:
            logger.warning(line)
        self._counters, self._stamps = Counters(), Stamps(self)
        self._frame_context = FrameContext(self, config, self._chosen)
        self._answers = MatchPublishers(
            self, config, lambda: self._frame_context.odometry.frame_id
        )
        self._recognition = Recognition(
            pipeline,
            self._frame_context,
            self._results,
            self._publish,
            self._counters,
            logger,
            self.context.ok,
        )
        self._worker: Worker[Arrival] = Worker(
            self._recognition.handle,
            config.queue_size,
            config.max_wait_s,
            QUEUE_BYTES,
            at_end=self._recognition.close,
        )
        self._maps = MapServices(
            self,
            self._worker,
            self._recognition,
            self._open_pipeline,
            config.save_map_path,
            config.result_file,
        )
        self.create_service(Trigger, '~/reset', self._on_reset, qos_profile=SERVICE_QOS)
        self.create_service(
            SetBool, '~/set_enabled', self._on_set_enabled, qos_profile=SERVICE_QOS
        )
        self._transform = None
        if config.publish_tf:
            self._transform = MeasuredTransform(self, config)
            self._frame_context.odometry.tell(self._transform.on_odometry)
        self._initial_poses = InitialPoses(self, config.map_frame, self._on_initial_pose)
        self._localization = LocalizationTopics(
            self, config, self._situation, self._advice, self._initial_poses
        )
        self._diagnostics = Diagnostics(
            self, self._counters, self._situation, config.diagnostics_period_s
        )
        self._progress = ProgressLog(
            self, self._counters, lambda: {**self._worker.drops, 'middleware': self._lost()}
        )
        self._warm = self.create_guard_condition(self._on_warm)

    def listen(self) -> None:
        self._listening = True
        for images in self._images:
            images.start()
        self._maps.announce()
        self.get_logger().info(f'listening to {self._topic}')

    def pause(self) -> None:
        self._listening = False
        for images in self._images:
            images.stop()
        self.get_logger().info('not listening')

    def close_work(self, patience_s: float = PATIENCE_S) -> None:
        if not self._is_open:
            return
        self._is_open = self._listening = False
        for images in self._images:
            images.stop()
        self._localization.give_up()
        if not self._worker.stop(patience_s) and self._ready:
            self.get_logger().warning('stopped in the middle of a frame')
        self._progress.finish(self._worker.waiting)
        self._maps.finish()
        self._results.close()
        self._ready = False

    def destroy_node(self) -> None:
        self.close_work(_STOP_TIMEOUT_S if self._ready else 0.0)
        super().destroy_node()

    def _warm_up(self) -> None:
        """Prepare for the first frame, in the worker's thread."""
        start_s = time.monotonic()
        pipeline = self._recognition.pipeline
        try:
            pipeline.warm_up()
        except ConvseqError as error:
            self.get_logger().error(one_line(error))
        gc.freeze()  # all objects so far stay: the collector need not visit them again
        took_s = time.monotonic() - start_s
        if pipeline.slow:
            self.get_logger().warning(pipeline.slow)
        self.get_logger().info(f'kernel {pipeline.kernel}, ready after {took_s:.1f} s')
        self._recognition.link()
        try:
            self._answers.map_topics.follow(
                pipeline.recognizer.reference_map, self._node_config.map_frame
            )
            self._warm.trigger()
        except Exception:
            # Publishing fails while the node ends, or a signal shuts ROS down.
            if self._is_open and self.context.ok():
                raise

    def _open_pipeline(self, path: Path | None, make: bool = True) -> Pipeline:
        config = masked(self._config, read_mask(self._config))
        return Pipeline(path, config, make, self._chosen, open_model(config))

    def _on_warm(self) -> None:
        self._ready = self._is_open
        if self._is_open and not (self._listening or self._is_managed):
            self.listen()

    def _publish(self, answered: Answered) -> None:
        match = answered.match
        estimate = self._answers.publish(answered)
        self._localization.update(match, estimate)
        if self._transform:
            sigma_m = answered.position_sigma_m(self._node_config)
            self._transform.update(answered.frame, match, estimate, sigma_m)

    def _on_image(self, message: RawMessage, topic: str) -> None:
        arrival_ns = time.monotonic_ns()
        self._counters.received += 1
        if not self._enabled:
            return
        stamp_ns = self._stamps.of(message, arrival_ns, topic)
        number = self._counters.received - 1
        arrival = Arrival(message, stamp_ns, arrival_ns, topic, number)
        self._worker.put(arrival, len(message.cdr))

    def _on_parameters(self, config: Config, node_config: NodeConfig) -> None:
        self._config, self._node_config = config, node_config
        if not self._is_open:
            return
        self._maps.configure(node_config.save_map_path)
        self._worker.configure(node_config.queue_size, node_config.max_wait_s)
        self._frame_context.odometry.wait_s = node_config.odom_wait_s
        self._diagnostics.configure(node_config.diagnostics_period_s)

        def apply() -> None:
            self._recognition.pipeline.cameras.configure(config)
            self._answers.configure(node_config)
            self._localization.configure(node_config)

        self._worker.between_items(apply)

    def _forget(self) -> None:
        self._recognition.pipeline.cameras.reset()

    def _on_initial_pose(self, estimate: PoseEstimate) -> None:
        self._worker.between_items(partial(self._expect, estimate))

    def _expect(self, estimate: PoseEstimate) -> None:
        """Look first near a pose that others tell, in the worker's thread."""
        if count := self._recognition.pipeline.cameras.expect(estimate):
            self.get_logger().info(f'initialpose: {count} places near {estimate} come first')
        else:
            line = f'no place of the map with a pose is near {estimate}'
            self._initial_poses.leave_out(line)

    def _on_reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._worker.between_items(self._forget)
        response.success, response.message = True, 'the query sequence starts anew'
        return response

    def _on_set_enabled(
        self, request: SetBool.Request, response: SetBool.Response
    ) -> SetBool.Response:
        if request.data and not self._enabled:
            # Frames before the pause are not part of the sequence of those after it.
            self._worker.between_items(self._forget)
        self._enabled = request.data
        response.success, response.message = True, 'enabled' if request.data else 'disabled'
        return response

    @property
    def _topic(self) -> str:
        """The topics of the cameras, separated by spaces."""
        return ' '.join(images.topic for images in self._images)

    def _lost(self) -> int:
        return sum(images.lost for images in self._images)

    def _advice(self) -> str:
        return '; '.join(images.advice() for images in self._images)

    def _silences(self) -> dict[str, str]:
        odometry = self._frame_context.odometry
        of_images = {images.topic: images.silence for images in self._images}
        return of_images | {odometry.topic: odometry.silence}

    def _situation(self) -> Situation:
        pipeline, odometry = self._recognition.pipeline, self._frame_context.odometry
        return Situation(
            ready=self._ready,
            enabled=self._enabled and (self._listening or not self._ready),
            pipeline=pipeline,
            topic=self._topic,
            dropped=self._worker.dropped,
            odometry_comes=odometry.heard and not odometry.silence,
            silences=self._silences,
            further={
                'queue': self._worker.waiting,
                'lost_by_middleware': self._lost(),
                'clock_jumps': pipeline.cameras.resets,
                'odometry_jumps': pipeline.cameras.odometry_jumps,
                'result_rows_lost': self._results.lost,
                'camera_info': self._frame_context.camera.is_calibrated,
                'initial_poses_left_out': self._initial_poses.left_out,
                'frames_without_pose': odometry.without_pose,
                **(self._transform.values if self._transform else {}),
            },
            transform_problem=self._transform.problem if self._transform else '',
            model_problem=self._recognition.model_problem,
            stamp_problem=self._stamps.problem,
        )


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM; return the exit code."""
    return run_until_signal(VprNode, args)


if __name__ == '__main__':
    leave(main())
