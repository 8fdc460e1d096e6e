# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The node's result file, which may fail without stopping the node."""

from pathlib import Path
import threading
from typing import Any

from convseq_ros.core.types import Match
from convseq_ros.errors import ConfigError
from convseq_ros.results import ResultWriter


class ResultLog:
    """
    Writes a row for every frame until that fails; says so once and counts what is `lost`.

    To none if the path is empty; ConfigError if the file cannot be made.
    """

    def __init__(self, path: str, logger: Any) -> None:
        self.lost = 0
        self._path = path
        self._logger = logger
        self._lock = threading.Lock()
        self._failed = False
        self._writer: ResultWriter | None = None
        if path:
            try:
                self._writer = ResultWriter(Path(path))
            except OSError as error:
                raise ConfigError(
                    f'result_file: {path} cannot be written ({error.strerror}); '
                    'choose another or leave it empty'
                ) from None
            if self._writer.kept:
                logger.warning(f'{self._writer.kept}: rows of a run that did not end')

    def write(self, match: Match, duration_ms: float) -> None:
        with self._lock:
            if self._failed:
                self.lost += 1
            elif self._writer:
                try:
                    self._writer.write(match, duration_ms)
                except OSError as error:
                    self._give_up(self._writer, match, error)

    def close(self) -> None:
        """Give the file its name; rows that come later are left out."""
        with self._lock:
            if self._writer:
                try:
                    self._writer.close()
                except OSError as error:
                    self._logger.error(f'{self._path}: not completed ({error.strerror})')
            self._writer = None

    def _give_up(self, writer: ResultWriter, match: Match, error: OSError) -> None:
        self._logger.error(
            f'{self._path}: {error.strerror}; going on without rows from frame '
            f'{match.query_index} on'
        )
        self._failed = True
        self.lost += 1
        self._writer = None
        writer.abandon()
