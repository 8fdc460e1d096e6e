# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The node's table of answers, which neither a full disk nor another process stops."""

from pathlib import Path
from threading import Lock
from typing import Any

from convseq_ros.app.result_row import COLUMNS, row
from convseq_ros.core.types import Match
from convseq_ros.errors import ConfigError
from convseq_ros.io.results import ResultWriter


class ResultLog:
    """Writes rows if `path` is not empty; after a failure, counts the `lost` rows instead."""

    def __init__(self, path: str, logger: Any) -> None:
        self.lost = 0
        self._path = path
        self._logger = logger
        self._lock = Lock()
        self._failed = False
        self._writer: ResultWriter | None = None
        if path:
            try:
                self._writer = ResultWriter(Path(path), COLUMNS, keeps_earlier=True)
            except OSError as error:
                raise ConfigError(
                    f'result_file: {path} cannot be written ({error.strerror}); '
                    'choose another or leave it empty'
                ) from None

    def write(self, match: Match, duration_ms: float) -> None:
        with self._lock:
            if writer := self._writer:
                try:
                    writer.write(row(match, duration_ms))
                except OSError as error:
                    self._logger.error(
                        f'{self._path}: {error.strerror}; going on without rows from frame '
                        f'{match.query_index} on'
                    )
                    self._writer, self._failed = None, True
            self.lost += self._failed

    def close(self) -> None:
        """Complete the file; later rows are left out."""
        with self._lock:
            if self._writer:
                try:
                    self._writer.close()
                except OSError as error:
                    self._logger.error(f'{self._path}: not completed ({error.strerror})')
            self._writer = None
