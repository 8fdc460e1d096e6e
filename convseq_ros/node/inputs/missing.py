# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Images at whose time odometry has no pose."""

from typing import Any

_MANY = 20  # in a row, that are worth a warning


class Missing:
    """Counts images without a pose, and logs once that many in a row have none."""

    def __init__(self, logger: Any) -> None:
        self.count = self._in_a_row = 0
        self._logger, self._is_told = logger, False

    def note(self, is_missing: bool, topic: str, stamp_ns: int, newest_ns: int) -> None:
        """Take in the next image, of a stamp, and the newest stamp of the topic."""
        self.count += is_missing
        self._in_a_row = self._in_a_row + 1 if is_missing else 0
        if self._in_a_row >= _MANY and not self._is_told:
            self._is_told = True
            ahead_s = (newest_ns - stamp_ns) / 1e9
            self._logger.warning(
                f'{topic}: has no pose at the time of the images; its newest stamp is '
                f'{abs(ahead_s):.1f} s {"later" if ahead_s > 0 else "earlier"}; check that it '
                'comes and that both clocks agree'
            )
