# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The ROS node: images in, recognised places out."""

from functools import partial
from pathlib import Path
import signal
import sys
import time
from typing import Any

from convseq_ros.config import Config, NodeConfig
from convseq_ros.core.map_file import open_map, save_map
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.reference_map import ReferenceMap
from convseq_ros.errors import ConvseqError, MapError
from convseq_ros.node.conversions import stamp_to_ns
from convseq_ros.node.diagnostics import Diagnostics, Situation
from convseq_ros.node.image_subscription import ImageMessage, ImageSubscription
from convseq_ros.node.parameters import declare
from convseq_ros.node.publishers import MatchPublishers
from convseq_ros.node.recognition import Arrival, Recognition
from convseq_ros.node.result_log import ResultLog
from convseq_ros.node.services import in_background
from convseq_ros.node.statistics import Statistics
from convseq_ros.node.worker import Worker
from nav_msgs.srv import LoadMap
import rclpy
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.utilities import ok, try_shutdown
from std_srvs.srv import SetBool, Trigger

_STOP_TIMEOUT_S = 1.0


class VprNode(Node):
    """
    Recognises the places of a map in the images of a camera.

    The executor's thread only stamps and queues images, and answers services and parameters; all
    work on images is done in one thread of its own.

    Parameters
    ----------
    kwargs
        As for Node: context, namespace, parameter_overrides, cli_args ...

    Raises
    ------
    ConvseqError
        If a parameter is not allowed, or the map or the result file cannot be opened.

    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(
            'vpr_node', automatically_declare_parameters_from_overrides=True, **kwargs
        )
        logger = self.get_logger()
        try:
            self._config, config = declare(self, self._on_parameters)
            recognizer = _recognizer(config.map_path, self._config)
            self._results = ResultLog(config.result_file, logger)
        except (ConvseqError, OSError):
            super().destroy_node()
            raise
        self._node_config = config
        self._enabled = True
        self._map_path = config.map_path
        self._map = recognizer.reference_map
        self._statistics = Statistics()
        self._answers = MatchPublishers(self, config)
        self._recognition = Recognition(
            recognizer,
            self._results,
            self._answers.publish,
            self._statistics,
            logger,
            self.context.ok,
        )
        self._worker = Worker(self._recognition.handle, config.queue_size)
        self._offer_services()
        self._images = ImageSubscription(self, config, self._on_image)
        self._diagnostics = Diagnostics(
            self,
            self._statistics,
            self._situation,
            self._images.advice,
            config.diagnostics_period_s,
        )
        self._worker.start()
        self._announce_map()
        logger.info(f'listening to {self._images.topic}')

    def destroy_node(self) -> None:
        """Finish the frame at hand, close the result file and leave the graph."""
        if not self._worker.stop(_STOP_TIMEOUT_S):
            self.get_logger().warning('stopped in the middle of a frame')
        self._results.close()
        super().destroy_node()

    def _on_image(self, message: ImageMessage) -> None:
        arrival_ns = time.monotonic_ns()
        self._statistics.arrived(arrival_ns)
        if not self._enabled:
            return
        stamp_ns = stamp_to_ns(message.header.stamp)
        if not stamp_ns:
            stamp_ns = self.get_clock().now().nanoseconds
            self.get_logger().warning(
                f'{self._images.topic}: images have no stamp; using the time at which they arrive',
                once=True,
            )
        self._worker.put(Arrival(message, stamp_ns, arrival_ns, self._images.topic))

    def _on_parameters(self, config: Config, node_config: NodeConfig) -> None:
        self._config, self._node_config = config, node_config

        def apply() -> None:
            self._recognition.configure(config)
            self._answers.config = node_config

        self._worker.between_items(apply)

    def _offer_services(self) -> None:
        # Its own group, so that images and other services are served while a map is opened.
        group = MutuallyExclusiveCallbackGroup()
        self.create_service(LoadMap, '~/load_map', self._on_load_map, callback_group=group)
        self.create_service(Trigger, '~/save_map', self._on_save_map, callback_group=group)
        self.create_service(Trigger, '~/reset', self._on_reset)
        self.create_service(SetBool, '~/set_enabled', self._on_set_enabled)

    async def _on_load_map(
        self, request: LoadMap.Request, response: LoadMap.Response
    ) -> LoadMap.Response:
        path = request.map_url.removeprefix('file://')
        try:
            if not path:
                raise MapError('map_url is empty; give the path of a map')
            recognizer = await in_background(partial(_recognizer, path, self._config))
        except (MapError, OSError) as error:
            self.get_logger().error(str(error))
            response.result = (
                LoadMap.Response.RESULT_INVALID_MAP_DATA
                if Path(path).is_file()
                else LoadMap.Response.RESULT_MAP_DOES_NOT_EXIST
            )
            return response
        self._map_path, self._map = path, recognizer.reference_map
        self._worker.between_items(partial(self._recognition.swap, recognizer))
        self._announce_map()
        response.result = LoadMap.Response.RESULT_SUCCESS
        return response

    async def _on_save_map(
        self, _request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        path = self._node_config.save_map_path
        try:
            if not path:
                raise MapError('save_map_path is empty; set it to the file to write')
            if not len(self._map):
                raise MapError('there is no map to save')
            await in_background(partial(save_map, self._map, Path(path)))
        except (ConvseqError, OSError) as error:
            response.success, response.message = False, str(error)
            self.get_logger().error(f'save_map: {error}')
            return response
        response.success, response.message = True, path
        return response

    def _on_reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._worker.between_items(self._recognition.reset)
        response.success, response.message = True, 'the query sequence starts anew'
        return response

    def _on_set_enabled(
        self, request: SetBool.Request, response: SetBool.Response
    ) -> SetBool.Response:
        if request.data and not self._enabled:
            # What came before the pause is not the past of what comes now.
            self._worker.between_items(self._recognition.reset)
        self._enabled = request.data
        response.success, response.message = True, 'enabled' if request.data else 'disabled'
        return response

    def _announce_map(self) -> None:
        if len(self._map):
            text = f'recognising {len(self._map)} places of {self._map_path}'
        else:
            text = 'no map yet; waiting for ~/load_map'
        self.get_logger().info(text)

    def _situation(self) -> Situation:
        return Situation(
            enabled=self._enabled,
            map_path=self._map_path,
            map_size=len(self._map),
            topic=self._images.topic,
            waiting=self._worker.waiting,
            dropped=self._worker.dropped,
            lost=self._images.lost,
            rows_lost=self._results.lost,
            clock_jumps=self._recognition.clock_jumps,
        )


def _recognizer(map_path: str, config: Config) -> PlaceRecognizer:
    """Return a recogniser with the map of that path; with an empty map for no path."""
    if not map_path:
        return PlaceRecognizer(ReferenceMap(config.encoding), config)
    return PlaceRecognizer(open_map(Path(map_path), config.encoding), config)


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM; return the exit code."""
    # rclpy's own handler, installed by init, ends the spinning and then calls this one, which
    # keeps Python from raising KeyboardInterrupt in the middle of the tidying up.
    signal.signal(signal.SIGINT, lambda *_: None)
    try:
        rclpy.init(args=args)
    except RuntimeError as error:
        return _refuse(error)
    try:
        _run()
    except (ConvseqError, OSError) as error:
        return _refuse(error)
    except (ExternalShutdownException, RuntimeError):
        # Whatever is under way fails when a signal shuts ROS down.
        if ok():
            raise
    finally:
        try_shutdown()
        # Python gives signals back their deadly default before it is gone.
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)
    return 0


def _run() -> None:
    executor = SingleThreadedExecutor()
    node = VprNode()
    try:
        rclpy.spin(node, executor)
    finally:
        node.destroy_node()


def _refuse(error: Exception) -> int:
    get_logger('vpr_node').error(' '.join(str(error).split()))
    return 1


if __name__ == '__main__':
    sys.exit(main())
