# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A map that was made without links gets them while frames are answered."""

from threading import Event, Thread
import time
import traceback
from typing import Any

from convseq_ros.core.linking import link_map, not_linked
from convseq_ros.core.session import Session
from convseq_ros.errors import ConvseqError

_PATIENCE_S = 5.0  # for the place at hand, at the end


class MapLinking:
    """
    Looks up the places of a map in what comes before them, in a thread of its own.

    It rests as long as it works, so that half of a core stays for the answers. A map that grows
    keeps the links in its file, another one in memory. Of a map that has all its links, nothing is
    done.
    """

    def __init__(self, session: Session, logger: Any) -> None:
        self._session, self._logger, self._end = session, logger, Event()
        self._thread = Thread(target=self._run, name='linking', daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Leave the rest; what is linked stays linked."""
        self._end.set()
        self._thread.join(_PATIENCE_S)

    def _run(self) -> None:
        try:
            self._link()
        except ConvseqError as error:
            self._logger.error(f'linking: {error}')
        except Exception:
            # The map answers without links, too.
            self._logger.error(traceback.format_exc())

    def _link(self) -> None:
        recognizer, path = self._session.recognizer, self._session.path
        whole = recognizer.reference_map
        if not (count := sum(map(len, not_linked(whole)))):
            return
        self._logger.info(f'linking {count} places of {path}, which was made without links')
        began_s, tenths = time.monotonic(), 0
        for done, _ in enumerate(link_map(whole, recognizer.config), 1):
            if 10 * done // count > tenths:
                tenths = 10 * done // count
                self._logger.info(f'linking {path}: {10 * tenths} %, {len(whole.links)} links')
            if self._end.wait(time.monotonic() - began_s):
                return
            began_s = time.monotonic()
