# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Frames with what else is known of their time: poses, depth images and the camera."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from convseq_ros.core.types import Camera, Frame, Pose
from convseq_ros.sources.camera_info import fitted, misfit
from convseq_ros.sources.depth import DepthAt, unregistered
from convseq_ros.sources.pose_file import PoseAt
from convseq_ros.sources.source import Source

CameraOf = Callable[[int, int], Camera]  # from an image's height and width in pixels


@dataclass(eq=False)
class AnnotatedFrames:
    """The frames of a source with their poses, depth images and the camera that took them."""

    source: Source
    pose_at: PoseAt | None
    camera_of: CameraOf | None
    depth_at: DepthAt | None = None
    poses_of: str = ''  # topic or file
    mount: Pose | None = None  # of the camera, if it is known
    depth_of: str = ''  # topic or folder

    def __post_init__(self) -> None:
        self.name, self.topic = self.source.name, self.source.topic
        self.warnings = self.source.warnings

    def __len__(self) -> int:
        return len(self.source)

    def __iter__(self) -> Iterator[Frame]:
        described: Camera | None = None
        index, lacking = -1, {self.poses_of: 'pose', self.depth_of: 'depth image'}
        lacking.pop('', None)
        for index, frame in enumerate(self.source):
            pose = self.pose_at(index, frame.stamp_ns) if self.pose_at else None
            if pose:
                lacking.pop(self.poses_of, None)
            camera = None
            if self.camera_of and frame.gray is not None:
                if described is None:
                    described = replace(self.camera_of(*frame.gray.shape), mount=self.mount)
                    self._warn(misfit(described, *frame.gray.shape))
                camera = fitted(described, *frame.gray.shape)
            depth_m = self.depth_at(index, frame.stamp_ns) if self.depth_at else None
            if depth_m is not None:
                lacking.pop(self.depth_of, None)
                if frame.gray is not None and (line := unregistered(depth_m, frame.gray.shape)):
                    self._warn(f'{self.depth_of}: {line}')
            yield replace(frame, pose=pose, camera=camera, depth_m=depth_m)
        for name, what in lacking.items() if index >= 0 else ():
            self._warn(
                f'{name} has no {what} at the time of an image; check that it covers the drive, '
                'and that both clocks agree'
            )

    def _warn(self, line: str) -> None:
        """Add a line to the warnings, once; an empty one is none."""
        if line and line not in self.warnings:
            self.warnings.append(line)
