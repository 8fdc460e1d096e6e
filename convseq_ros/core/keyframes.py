# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which frames of a drive become references."""

from convseq_ros.config import KeyframeConfig
from convseq_ros.core.matching.regional import similarity
from convseq_ros.core.types import Descriptor


class KeyframeSelector:
    """
    Chooses references by time, by scene change, or keeps every frame (the default).

    Parameters
    ----------
    config : KeyframeConfig
        Least time and largest similarity between two references.

    """

    def __init__(self, config: KeyframeConfig) -> None:
        self._interval_ns = round(config.keyframe_interval_s * 1e9)
        self._overlap = config.keyframe_overlap
        self._last: tuple[int, Descriptor] | None = None

    def wants(self, stamp_ns: int, descriptor: Descriptor) -> bool:
        """
        Decide about the next frame; a wanted one counts as kept.

        Uninformative frames are kept only where every frame is.
        """
        if self._overlap < 1.0 and not descriptor.informative:
            return False
        if self._last is not None:
            last_ns, last = self._last
            if 0 <= stamp_ns - last_ns < self._interval_ns:
                return False
            if self._overlap < 1.0 and similarity(descriptor, last) > self._overlap:
                return False
        self._last = stamp_ns, descriptor
        return True
