# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A robot's link to a fleet, which may fail at any time without delaying the robot."""

from collections import deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from threading import Condition, Thread
import time
from typing import Any

from convseq_ros.config import Config
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.types import Frame, Match
from convseq_ros.errors import ConvseqError, FleetError
from convseq_ros.fleet.cluster import checked_address, Cluster, connected
from convseq_ros.fleet.fleet import Fleet
from convseq_ros.models.onnx_model import open_model

Publish = Callable[[Match, float, PlaceRecognizer], None]  # a match, its milliseconds, by whom

_NAME = 'convseq_ros'  # of the data set on a scheduler with the paths of its maps
_AGAIN_S = 5.0  # after which a fleet that is gone is searched for again
_MOST_WAITING = 10  # frames


def serve(client: Any, paths: Sequence[Path]) -> None:
    """Publish on a scheduler which maps form its fleet."""
    client.publish_dataset([str(path.resolve()) for path in paths], name=_NAME, override=True)


class FleetLink:
    """
    Sends frames to a scheduler's fleet in a separate thread; reconnects when the fleet is gone.

    `publish` receives each answer in the link's thread; a question without an answer within
    `timeout_s` has failed. `problem` is why the fleet does not answer; `answered` and `skipped`
    count frames. FleetError if the address is not allowed.
    """

    def __init__(
        self,
        cluster: Cluster,
        config: Config,
        publish: Publish,
        timeout_s: float,
        sources: Sequence[str] = (),
    ) -> None:
        checked_address(cluster)
        self._sources = sources
        self.problem, self.answered, self.skipped = 'looking for it', 0, 0
        self._cluster, self._publish, self._timeout_s = cluster, publish, timeout_s
        matching = replace(config.matching, search='shortlist')
        self._config = replace(
            config, matching=matching, online=replace(config.online, mode='preloaded')
        )
        self._waiting, self._changed, self._is_ending = deque[Frame](), Condition(), False
        self._is_reset = False
        self._thread = Thread(target=self._run, name='fleet', daemon=True)
        self._thread.start()

    def put(self, frame: Frame) -> None:
        """Queue a frame; the oldest is skipped if too many wait."""
        with self._changed:
            self._waiting.append(frame)
            while len(self._waiting) > (0 if self.problem else _MOST_WAITING):
                self._waiting.popleft()
                self.skipped += 1
            self._changed.notify()

    def reset(self) -> None:
        """Start a new drive."""
        with self._changed:
            self._waiting.clear()
            self._is_reset = True

    def close(self, timeout_s: float = 1.0) -> None:
        """End the thread; do not wait for a question that takes long."""
        with self._changed:
            self._is_ending = True
            self._changed.notify()
        self._thread.join(timeout_s)

    def _run(self) -> None:
        while not self._is_ending:
            try:
                with ExitStack() as opened:
                    client = opened.enter_context(connected(self._cluster))
                    self._answer(self._opened(client))
            except ConvseqError as error:
                self.problem = str(error)
            except Exception as error:
                # A cluster that goes away may raise anything; the robot goes on.
                self.problem = f'{type(error).__name__}: {error}'
            with self._changed:
                self.skipped += len(self._waiting)
                self._waiting.clear()
                self._changed.wait_for(lambda: self._is_ending, _AGAIN_S)

    def _opened(self, client: Any) -> Fleet:
        paths = client.get_dataset(_NAME, default=None)
        if not paths:
            raise FleetError(
                f'{self._cluster.scheduler}: serves no maps; run `convseq fleet serve MAPS`'
            )
        opened = [Path(path) for path in paths]
        model = open_model(self._config)
        fleet = Fleet(client, opened, self._config, sources=self._sources, describe=model)
        fleet.timeout_s = self._timeout_s
        return fleet

    def _answer(self, fleet: Fleet) -> None:
        cameras = fleet.cameras
        self.problem = ''
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._is_ending or self._waiting)
                if self._is_ending:
                    return
                frame = self._waiting.popleft()
                is_reset, self._is_reset = self._is_reset, False
            if is_reset:
                cameras.reset()
            started = time.perf_counter()
            match = cameras.process(frame)
            if len(fleet.missing) == len(fleet.paths):
                raise FleetError(f'no map answers: {fleet.missing[0]}')
            self.answered += 1
            self._publish(match, 1e3 * (time.perf_counter() - started), cameras.of(frame.source))
