# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The scenes that a drive has passed: keyframes that show something else, whatever the noise."""

from convseq_ros.core.encoding.glance import distance, GLANCE, Glance


class Scenes:
    """Counts scenes over a drive; noise alone makes keyframes of one scene, but no scenes."""

    def __init__(self) -> None:
        self.passed = 0
        self._last: Glance | None = None  # of the last scene

    def count(self, edges: Glance | None) -> None:
        """Take in a keyframe; it is a new scene if its glance is far from that of the last one."""
        if edges is None or self._last is None or distance(edges, self._last) > GLANCE.moved:
            self.passed, self._last = self.passed + 1, edges
