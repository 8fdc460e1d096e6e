# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The frames of several cameras of one robot, in the order of their stamps."""

from collections.abc import Iterator, Sequence
import heapq

from convseq_ros.core.types import Frame
from convseq_ros.sources.annotated import Frames


class SeveralCameras:
    """The frames of some sources, at least one, together; each frame tells its source."""

    def __init__(self, sources: Sequence[Frames], pose_frame: str = '') -> None:
        self._sources, self.pose_frame = sources, pose_frame
        self.name, self.topic = sources[0].name, ' '.join(one.topic for one in sources)
        self.warnings: list[str] = []

    def __len__(self) -> int:
        return sum(map(len, self._sources))

    def __iter__(self) -> Iterator[Frame]:
        yield from heapq.merge(*self._sources, key=lambda frame: frame.stamp_ns)
        self.warnings[:] = [line for one in self._sources for line in one.warnings]
