# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What all sources of frames have in common."""

from collections.abc import Iterator, Sequence
import heapq
from typing import Protocol

from convseq_ros.core.types import Frame


class Lines(list[str]):
    """Lines for the user."""

    def add(self, line: str) -> None:
        """Append a line, once; an empty one is none."""
        if line and line not in self:
            self.append(line)


class Source(Protocol):
    """A stream of frames that can be read more than once."""

    name: str  # of the folder or recording
    topic: str  # of the images; empty for a folder
    warnings: Lines  # for the user, one line each; grows while the source is read

    def __len__(self) -> int:
        """Return the expected number of frames, by an index or a directory."""

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames in order; each call starts anew."""


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
