# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Lines about single messages, of which each text is logged once."""

import re
from typing import Any

_BYTES = re.compile(r'\b\d+ bytes')  # which differ from one damaged picture to the next
_MOST = 20  # different texts: whoever sends messages may make up new ones for ever


class Once:
    """Logs each of the first 20 different lines once."""

    def __init__(self, logger: Any) -> None:
        self._logger = logger
        self._told = set[str]()

    def warn(self, text: str) -> None:
        """Log a warning, unless it was logged before, perhaps with another number of bytes."""
        if self._is_new(_BYTES.sub('', text)):
            self._logger.warning(f'{text}; from now on this is only counted')

    def note(self, text: str) -> None:
        """Log what the program found out by itself, unless it was logged before."""
        if self._is_new(text):
            self._logger.info(text)

    def _is_new(self, kind: str) -> bool:
        if kind in self._told or len(self._told) >= _MOST:
            return False
        self._told.add(kind)
        return True
