# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Several cameras of one drive, as one source."""

from collections.abc import Iterator, Sequence
import heapq

from convseq_ros.core.types import Frame
from convseq_ros.sources.source import Lines, Source


class SeveralCameras:
    """The frames of at least one source, in the order of their stamps."""

    def __init__(self, sources: Sequence[Source]) -> None:
        self._sources = sources
        self.name, self.topic = sources[0].name, ' '.join(source.topic for source in sources)
        self.warnings = Lines()

    def __len__(self) -> int:
        return sum(map(len, self._sources))

    def __iter__(self) -> Iterator[Frame]:
        yield from heapq.merge(*self._sources, key=lambda frame: frame.stamp_ns)
        lines = [line for source in self._sources for line in source.warnings]
        self.warnings[:] = dict.fromkeys(lines)  # cameras may share poses
