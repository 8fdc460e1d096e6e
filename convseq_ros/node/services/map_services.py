# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Services that load and save maps while frames arrive, without losing one."""

from collections.abc import Callable
from concurrent.futures import Future, wait
from functools import partial
from os.path import isfile
from pathlib import Path
import time
from typing import TypeVar

from convseq_ros.app.pipeline import Pipeline
from convseq_ros.config.arguments import local
from convseq_ros.core.map.format import is_map_or_empty
from convseq_ros.core.map.reader import map_id_of
from convseq_ros.core.map.writer import save_map
from convseq_ros.errors import MapError, NO_PLACES, one_line, with_traceback
from convseq_ros.io.output_file import ANY, OutputFile
from convseq_ros.node.qos import SERVICE_QOS
from convseq_ros.node.services.recognition import Arrival, Recognition
from convseq_ros.node.services.worker import BackgroundWork, fulfil, Worker
from nav_msgs.srv import LoadMap
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node
from std_srvs.srv import Trigger

Result = TypeVar('Result')

_ANSWER_S = 30.0
_POLL_S = 0.05


class MapServices:
    """Offers `~/load_map` and `~/save_map`; maps are replaced between two frames."""

    def __init__(
        self,
        node: Node,
        worker: Worker[Arrival],
        recognition: Recognition,
        open_pipeline: Callable[[Path, bool], Pipeline],
        save_path: str,
        result_file: str,
    ) -> None:
        self._save_path, self._result_file = save_path, result_file
        self._logger, self._name = node.get_logger(), node.get_fully_qualified_name()
        self._worker = worker
        self._recognition = recognition
        self._open_pipeline = open_pipeline
        self._background = BackgroundWork()
        # A separate group, so that images and other services are served while a map is opened.
        group = MutuallyExclusiveCallbackGroup()
        offer = partial(node.create_service, qos_profile=SERVICE_QOS, callback_group=group)
        offer(LoadMap, '~/load_map', self._on_load_map)
        offer(Trigger, '~/save_map', self._on_save_map)

    def configure(self, save_path: str) -> None:
        """Save the map to another file from now on."""
        self._save_path = save_path

    def announce(self) -> None:
        pipeline = self._recognition.pipeline
        count = len(pipeline.recognizer.reference_map)
        if pipeline.is_growing:
            where = pipeline.path or 'memory; what it holds is lost at the end, without a map_path'
            text = f'recognising {count} places and adding to them, in {where}'
        elif count:
            text = f'recognising {count} places of {pipeline.path}'
        elif pipeline.path:
            text = f'{pipeline.path} {NO_PLACES}'
        else:
            text = (
                'no map yet: map_path is empty, and sections of a parameter file are read if '
                f'they name {self._name} or /**; waiting for ~/load_map'
            )
        self._logger.info(text)

    def finish(self) -> None:
        """Wait for the services to finish their work."""
        self._background.finish()

    async def _on_load_map(
        self, request: LoadMap.Request, response: LoadMap.Response
    ) -> LoadMap.Response:
        path = local(request.map_url)
        try:
            if not path:
                raise MapError('map_url is empty; give the path of a map')
            pipeline = await self._background.result_of(partial(self._open, Path(path)))
            swap = partial(self._recognition.swap, pipeline)
            try:
                await self._background.result_of(partial(self._between_frames, swap))
            except BaseException:
                pipeline.close()
                raise
        except Exception as error:
            self._logger.error(f'load_map: {with_traceback(error)}')
            # Unlike Path.is_file, this never raises.
            response.result = (
                LoadMap.Response.RESULT_INVALID_MAP_DATA
                if isfile(path)
                else LoadMap.Response.RESULT_MAP_DOES_NOT_EXIST
            )
            return response
        self.announce()
        response.result = LoadMap.Response.RESULT_SUCCESS
        return response

    def _open(self, path: Path) -> Pipeline:
        if _grows_in(self._recognition.pipeline, path):
            raise MapError(f'{path}: is already the map in use, and grows; name another')
        pipeline = self._open_pipeline(path, False)
        for line in pipeline.ignored:
            self._logger.warning(line)
        try:
            pipeline.warm_up()
        except BaseException:
            pipeline.close()
            raise
        return pipeline

    async def _on_save_map(
        self, _request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        try:
            response.message = await self._background.result_of(self._save)
        except Exception as error:
            response.success, response.message = False, one_line(error)
            self._logger.error(f'save_map: {with_traceback(error)}')
            return response
        response.success = True
        return response

    def _save(self) -> str:
        """Save the map as it is now; return the path."""
        pipeline = self._recognition.pipeline
        if not len(pipeline.recognizer.reference_map):
            raise MapError('there is no map to save; load one with ~/load_map')
        if self._save_path:
            target = Path(self._save_path)
            if _grows_in(pipeline, target):
                raise MapError(f'{target}: is the map that is growing; leave save_map_path empty')
            results = [Path(self._result_file)] if self._result_file else []
            OutputFile('save_map_path', target, ANY).refuse(results)
            saved = pipeline.recognizer.reference_map
            _refuse_another(target, saved.map_id)
            save_map(saved, target)
            return self._save_path
        if pipeline.is_persisted:
            pipeline.flush()
            return str(pipeline.path)
        raise MapError('save_map_path is empty; set it to the file to write')

    def _between_frames(self, work: Callable[[], Result]) -> Result:
        """Run work in the worker's thread and return its result; not to be called in there."""
        future: Future[Result] = Future()
        self._worker.between_items(partial(fulfil, future, work))
        deadline_s = time.monotonic() + _ANSWER_S
        while not future.done():
            if self._worker.is_stopping and future.cancel():
                raise MapError('the node is ending')
            if time.monotonic() > deadline_s and future.cancel():
                raise MapError(f'the frame at hand takes more than {_ANSWER_S:g} s; try again')
            wait([future], _POLL_S)
        return future.result()


def _grows_in(pipeline: Pipeline, path: Path) -> bool:
    """Return whether places are added to this file, which may be gone."""
    own = pipeline.path if pipeline.is_persisted else None
    return bool(own and own.exists() and path.exists() and path.samefile(own))


def _refuse_another(target: Path, map_id: str) -> None:
    """Raise a MapError if a file is not empty, and is no map of this id: it is not replaced."""
    if not target.exists() or not target.stat().st_size:
        return
    # Anyone on the network may set the path.
    if not is_map_or_empty(target):
        raise MapError(f'{target}: is no map, and is not replaced; move it, or set save_map_path')
    if map_id_of(target) != map_id:
        raise MapError(
            f'{target}: is another map, and is not replaced; move it, or set save_map_path'
        )
