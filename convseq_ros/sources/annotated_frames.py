# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Frames with what else is known of their time: poses and the camera."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from convseq_ros.core.types import Camera, Frame, Pose
from convseq_ros.sources.camera_info import fitted, misfit
from convseq_ros.sources.pose_file import PoseAt
from convseq_ros.sources.source import Source

CameraOf = Callable[[int, int], Camera]  # from an image's height and width in pixels


@dataclass(eq=False)
class AnnotatedFrames:
    """The frames of a source with their poses and the camera that took them."""

    source: Source
    pose_at: PoseAt | None
    camera_of: CameraOf | None
    poses_of: str = ''  # topic or file
    mount: Pose | None = None  # of the camera, if it is known

    def __post_init__(self) -> None:
        self.name, self.topic = self.source.name, self.source.topic
        self.warnings = self.source.warnings

    def __len__(self) -> int:
        return len(self.source)

    def __iter__(self) -> Iterator[Frame]:
        described: Camera | None = None
        index, with_pose = -1, 0
        for index, frame in enumerate(self.source):
            pose = self.pose_at(index, frame.stamp_ns) if self.pose_at else None
            with_pose += pose is not None
            camera = None
            if self.camera_of and frame.gray is not None:
                if described is None:
                    described = replace(self.camera_of(*frame.gray.shape), mount=self.mount)
                    self.warnings.add(misfit(described, *frame.gray.shape))
                camera = fitted(described, *frame.gray.shape)
            yield replace(frame, pose=pose, camera=camera)
        if self.poses_of and 2 * with_pose <= index:
            of_images = f'{with_pose or "no"} pose{"s" * (with_pose > 1)} at the times of'
            self.warnings.add(
                f'{self.poses_of} has {of_images} {index + 1} images; check that it covers the '
                'drive, that both clocks agree, and that poses are at most 1.5 s apart'
            )
