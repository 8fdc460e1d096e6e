# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Frames that know where they were taken, and by which camera."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
import heapq
from typing import Protocol

from convseq_ros.core.types import Camera, Frame
from convseq_ros.sources.camera_info import fitted
from convseq_ros.sources.depth import DepthAt
from convseq_ros.sources.pose_file import PoseAt

CameraOf = Callable[[int, int], Camera]  # from an image's height and width in pixels


class Source(Protocol):
    """A stream of frames that can be read more than once."""

    name: str  # of the folder or recording
    topic: str  # of the images; empty for a folder
    warnings: list[str]  # for the user, one line each; grows while the source is read
    pose_frame: str  # what the poses of its frames are in, if others may be in the same; else ''

    def __len__(self) -> int:
        """Frames expected, as an index or a directory tells."""

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames in order; each call starts anew."""


@dataclass(eq=False)
class AnnotatedFrames:
    """The frames of a source with their poses, depth images and the camera that took them."""

    source: Source
    pose_at: PoseAt | None
    camera_of: CameraOf | None
    pose_frame: str = ''  # what the poses are in, if others may be in the same
    depth_at: DepthAt | None = None

    def __post_init__(self) -> None:
        self.name, self.topic = self.source.name, self.source.topic
        self.warnings = self.source.warnings

    def __len__(self) -> int:
        return len(self.source)

    def __iter__(self) -> Iterator[Frame]:
        described: Camera | None = None
        for index, frame in enumerate(self.source):
            pose = self.pose_at(index, frame.stamp_ns) if self.pose_at else None
            camera = frame.camera
            if self.camera_of and frame.gray is not None:
                described = described or self.camera_of(*frame.gray.shape)
                camera = fitted(described, *frame.gray.shape)
            depth_m = self.depth_at(index, frame.stamp_ns) if self.depth_at else frame.depth_m
            yield replace(frame, pose=pose or frame.pose, camera=camera, depth_m=depth_m)


class SeveralCameras:
    """The frames of some sources, at least one, by their stamps; each frame tells its source."""

    def __init__(self, sources: Sequence[Source]) -> None:
        self._sources, self.pose_frame = sources, sources[0].pose_frame
        self.name, self.topic = sources[0].name, ' '.join(one.topic for one in sources)
        self.warnings: list[str] = []

    def __len__(self) -> int:
        return sum(map(len, self._sources))

    def __iter__(self) -> Iterator[Frame]:
        yield from heapq.merge(*self._sources, key=lambda frame: frame.stamp_ns)
        self.warnings[:] = [line for one in self._sources for line in one.warnings]
