# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Links the places of a map while frames are answered."""

from threading import Event, Thread
import time
from typing import Any

from convseq_ros.app.map_builder import link_map, not_linked
from convseq_ros.app.pipeline import Pipeline
from convseq_ros.errors import with_traceback

_PATIENCE_S = 5.0  # at the end, for the place that is being linked


class MapLinking:
    """
    Links the places of a map to earlier places that show the same, in a separate thread.

    It pauses for as long as it works, so that half of a core stays free for frames. A growing map
    stores the links in its file, other maps keep them in memory. If no link is missing, nothing is
    done.
    """

    def __init__(self, pipeline: Pipeline, logger: Any) -> None:
        self._pipeline, self._logger, self._end = pipeline, logger, Event()
        self._thread = Thread(target=self._run, name='linking', daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Stop linking; the links so far stay."""
        self._end.set()
        self._thread.join(_PATIENCE_S)

    def _run(self) -> None:
        try:
            self._link()
        except Exception as error:
            # The map works without links, too.
            self._logger.error(f'linking: {with_traceback(error)}')

    def _link(self) -> None:
        recognizer, path = self._pipeline.recognizer, self._pipeline.path
        reference_map = recognizer.reference_map
        if not (count := sum(map(len, not_linked(reference_map)))):
            return
        self._logger.info(f'linking {count} places of {path}, which was made without links')
        began_s, tenths = time.monotonic(), 0
        for done, _ in enumerate(link_map(reference_map, recognizer.config), 1):
            if 10 * done // count > tenths:
                tenths, links = 10 * done // count, len(reference_map.links)
                self._logger.info(f'linking {path}: {10 * tenths} %, {links} links')
            if self._end.wait(time.monotonic() - began_s):
                return
            began_s = time.monotonic()
