# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Frames that know where they were taken, and by which camera."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Protocol

from convseq_ros.core.types import Camera, Frame, Pose
from convseq_ros.sources.camera_info import fitted


class Frames(Protocol):
    """What frames are read from; see `convseq_ros.sources.Source`."""

    name: str
    topic: str
    warnings: list[str]

    def __len__(self) -> int: ...

    def __iter__(self) -> Iterator[Frame]: ...


class AnnotatedFrames:
    """
    The frames of a source with the poses of a track and the camera that took them.

    Parameters
    ----------
    source : Frames
        A recording.
    pose_at : callable, optional
        From a stamp in nanoseconds to a Pose or None, such as `PoseTrack.at`.
    camera : Camera, optional
        As described by the recording.

    """

    def __init__(
        self, source: Frames, pose_at: Callable[[int], Pose | None] | None, camera: Camera | None
    ) -> None:
        self._source = source
        self._pose_at = pose_at
        self._camera = camera
        self.name, self.topic, self.warnings = source.name, source.topic, source.warnings

    def __len__(self) -> int:
        return len(self._source)

    def __iter__(self) -> Iterator[Frame]:
        for frame in self._source:
            pose = self._pose_at(frame.stamp_ns) if self._pose_at else None
            camera = self._camera
            if camera and frame.gray is not None:
                camera = fitted(camera, *frame.gray.shape)
            yield replace(frame, pose=pose or frame.pose, camera=camera or frame.camera)
