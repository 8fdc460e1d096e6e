# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Warnings about single messages, of which each text is logged once."""

from typing import Any

_MOST = 20  # different texts: whoever sends messages may make up new ones for ever


class Once:
    """Logs each of the first 20 different warnings once."""

    def __init__(self, logger: Any) -> None:
        self._logger = logger
        self._told = set[str]()

    def warn(self, text: str) -> None:
        """Log a warning, unless it was logged before."""
        if text not in self._told and len(self._told) < _MOST:
            self._told.add(text)
            self._logger.warning(f'{text}; from now on this is only counted')
