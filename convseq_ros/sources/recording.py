# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A ROS recording as a stream of frames, of raw messages, or of poses."""

from collections.abc import Iterator
from operator import itemgetter
from pathlib import Path
import sys
from typing import NamedTuple

from convseq_ros.core.types import Camera, Frame, Pose
from convseq_ros.errors import ImageError, SourceError
from convseq_ros.reading_config import ReadingConfig
from convseq_ros.sources.camera_info import camera_from_info
from convseq_ros.sources.images import compressed_pixels, gray_and_color, image_pixels
from convseq_ros.sources.nav_sat import Fix, fix_from_message, local_poses
from convseq_ros.sources.pose_track import pose_from_message
from convseq_ros.sources.storage import open_storage
from convseq_ros.sources.topics import (
    CAMERA_TYPES,
    choose_topic,
    FIX_TYPES,
    IMAGE_TYPES,
    merge_topics,
    POSE_TYPES,
    RawMessage,
    STAMP_END,
)

DECODERS = dict(zip(IMAGE_TYPES, (image_pixels, compressed_pixels), strict=True))


class Recording:
    """
    The images of a ROS 1 or ROS 2 recording, in the order in which they were recorded.

    The path is a folder that a recorder wrote, or a .mcap, .db3 or .bag file; the image topic may
    be left out if there is only one. Nothing is held in memory, and every iteration starts anew. A
    message that cannot be decoded gives a frame without an image that says why. `warnings` are
    what a user should know, one line each; they grow while the recording is read.

    SourceError if there is no recording, or no image topic, or several to choose from; while
    iterating, if the file is damaged further on.
    """

    pose_frame = ''

    def __init__(
        self, path: Path, topic: str = '', reading: ReadingConfig = ReadingConfig()
    ) -> None:
        self._path = path
        self._reading = reading
        self._storages, self.warnings = open_storage(path, reading)
        topics = merge_topics(storage.topics for storage in self._storages)
        chosen = choose_topic(path, topics, topic, IMAGE_TYPES, '--topic')
        self.name = path.resolve().name
        self.topic = chosen.name
        self.type_name = chosen.type_name
        self._count = min(chosen.count, sys.maxsize)
        for storage in self._storages:
            if storage.damage:
                saved = storage.topics.get(self.topic)
                count = saved.count if saved else 0
                self._warn(f'{storage.damage}; {count} frames of {self.topic} were saved')

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[Frame]:
        for message in self._raw_messages():
            try:
                pixels = DECODERS[message.type_name](message.decode(), self._reading)
            except ImageError as error:
                yield Frame(message.stamp_ns, None, self.topic, problem=str(error))
                continue
            if not message.header_stamp_ns:
                self._warn(
                    f'{self._path}: images of {self.topic} carry no stamp; '
                    'the time of recording was taken instead'
                )
            gray, color = gray_and_color(pixels, self._reading)
            yield Frame(message.stamp_ns, gray, self.topic, color=color)

    def messages(self) -> Iterator[RawMessage]:
        """Yield the image messages undecoded, as CDR, but for those too damaged for a stamp."""
        return (message for message in self._raw_messages() if len(message.cdr) >= STAMP_END)

    def _raw_messages(self) -> Iterator[RawMessage]:
        count = 0
        for storage in self._storages:
            for message in storage.messages(self.topic):
                if message.type_name == self.type_name:
                    count += 1
                    yield message
        if not count:
            raise SourceError(
                f'{self._path}: none of the {self._count} images of {self.topic} that its index '
                'lists is there; record again'
            )
        if count != self._count:
            self._warn(
                f'{self._path}: {count} images of {self.topic} were read, but its index lists '
                f'{self._count}; it may be damaged'
            )

    def _warn(self, text: str) -> None:
        if text not in self.warnings:
            self.warnings.append(text)


class Poses(NamedTuple):
    """Poses by their stamps in nanoseconds, in order of time, and the frame that they are in."""

    stamped: list[tuple[int, Pose]]
    frame: str = ''  # if other recordings may have poses in the same


def read_poses(
    path: Path, topic: str = '', reading: ReadingConfig = ReadingConfig()
) -> list[tuple[int, Pose]]:
    """Return what `read_poses_in` does, without their frame."""
    return read_poses_in(path, topic, reading).stamped


def read_poses_in(path: Path, topic: str = '', reading: ReadingConfig = ReadingConfig()) -> Poses:
    """
    Return the poses of a topic of odometry, of poses or of satellite fixes.

    It is of type nav_msgs/Odometry, geometry_msgs/PoseStamped or PoseWithCovarianceStamped, and
    may be left out if there is only one; or of sensor_msgs/NavSatFix, as `local_poses` takes it. A
    pose has the stamp of recording, if the header has none; damaged messages and values that are
    not finite are left out. SourceError if there is no such topic, no usable pose, or the
    recording is damaged.
    """
    chosen, messages = messages_of(path, topic, POSE_TYPES + FIX_TYPES, '--odom', reading)
    found = sorted((one for message in messages if (one := _pose(message))), key=itemgetter(0))
    if not found:
        raise SourceError(f'{path}: no pose of {chosen} is whole and finite; choose another topic')
    fixes = [one for one in found if isinstance(one, Fix)]
    if fixes:
        return Poses(*local_poses(fixes))
    return Poses([one for one in found if not isinstance(one, Fix)])


def read_camera(path: Path, topic: str = '', reading: ReadingConfig = ReadingConfig()) -> Camera:
    """Return the first calibrated camera of a topic, or of the only one; SourceError if none."""
    chosen, messages = messages_of(path, topic, CAMERA_TYPES, '--camera-info', reading)
    problem = 'K and P are zero, so it is not calibrated'
    for message in messages:
        try:
            camera = camera_from_info(message.decode())
        except (ImageError, SourceError) as error:
            problem = str(error)
            continue
        if camera:
            return camera
    raise SourceError(f'{path}: no camera of {chosen} can be used: {problem}')


def messages_of(
    path: Path,
    topic: str,
    types: tuple[str, ...],
    option: str,
    reading: ReadingConfig = ReadingConfig(),
) -> tuple[str, Iterator[RawMessage]]:
    """Return the name of a topic, chosen by `choose_topic`, and its messages in order."""
    storages, _ = open_storage(path, reading)
    topics = merge_topics(storage.topics for storage in storages)
    chosen = choose_topic(path, topics, topic, types, option)
    messages = (
        message
        for storage in storages
        for message in storage.messages(chosen.name)
        if message.type_name == chosen.type_name
    )
    return chosen.name, messages


def _pose(message: RawMessage) -> tuple[int, Pose] | Fix | None:
    try:
        decoded = message.decode()
    except ImageError:
        return None
    if message.type_name in FIX_TYPES:
        return fix_from_message(message.stamp_ns, decoded)
    own = decoded.pose if message.type_name == POSE_TYPES[1] else decoded.pose.pose
    pose = pose_from_message(own)
    return None if pose is None else (message.stamp_ns, pose)
