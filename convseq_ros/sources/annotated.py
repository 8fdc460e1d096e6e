# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Frames that know where they were taken, and by which camera."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Protocol

from convseq_ros.core.types import Camera, Frame
from convseq_ros.sources.camera_info import fitted
from convseq_ros.sources.depth_source import DepthAt
from convseq_ros.sources.pose_file import PoseAt

CameraOf = Callable[[int, int], Camera]  # from an image's height and width in pixels


class Frames(Protocol):
    """What frames are read from; see `convseq_ros.sources.Source`."""

    name: str
    topic: str
    warnings: list[str]

    def __len__(self) -> int: ...

    def __iter__(self) -> Iterator[Frame]: ...


class AnnotatedFrames:
    """
    The frames of a source with their poses, depth images and the camera that took them.

    `pose_at` and `depth_at` take a frame's number and its stamp in nanoseconds; they return None
    where nothing is known. `camera_of` takes the first readable image's height and width.
    `pose_frame` is what the poses are in, if others may be in the same.
    """

    def __init__(
        self,
        source: Frames,
        pose_at: PoseAt | None,
        camera_of: CameraOf | None,
        pose_frame: str = '',
        depth_at: DepthAt | None = None,
    ) -> None:
        self._source, self.pose_frame = source, pose_frame
        self._pose_at = pose_at
        self._camera_of, self._depth_at = camera_of, depth_at
        self.name, self.topic, self.warnings = source.name, source.topic, source.warnings

    def __len__(self) -> int:
        return len(self._source)

    def __iter__(self) -> Iterator[Frame]:
        described: Camera | None = None
        for index, frame in enumerate(self._source):
            pose = self._pose_at(index, frame.stamp_ns) if self._pose_at else None
            camera = frame.camera
            if self._camera_of and frame.gray is not None:
                described = described or self._camera_of(*frame.gray.shape)
                camera = fitted(described, *frame.gray.shape)
            depth_m = self._depth_at(index, frame.stamp_ns) if self._depth_at else frame.depth_m
            yield replace(frame, pose=pose or frame.pose, camera=camera, depth_m=depth_m)
