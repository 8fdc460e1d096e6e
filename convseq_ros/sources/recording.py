# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A ROS recording as a stream of frames, of raw messages, or of poses."""

from collections.abc import Iterator
from contextlib import suppress
from itertools import islice
from operator import itemgetter
from pathlib import Path
import sys

from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.core.types import Camera, Frame, Pose
from convseq_ros.errors import FormatError, ImageError, printable, SourceError
from convseq_ros.sources.camera_info import camera_from_info, correction
from convseq_ros.sources.images import gray_of, message_pixels
from convseq_ros.sources.mount import OdometryFrame, StaticTransforms
from convseq_ros.sources.pose_track import odometry_from_message, pose_from_message
from convseq_ros.sources.raw_message import IMAGE_TYPES, RawMessage, STAMP_END
from convseq_ros.sources.source import Lines
from convseq_ros.sources.stamps import FIRST, useless
from convseq_ros.sources.storage import open_storage
from convseq_ros.sources.topics import (
    CAMERA_TYPES,
    choose_topic,
    decode,
    merge_topics,
    POSE_TYPES,
    TF_TYPES,
)

_TF_STATIC = '/tf_static'


class TopicMessages:
    """
    The messages of a recording's topic, chosen by `choose_topic`; can be iterated again.

    `warnings` grow while messages are read: a line for each file that lost some to damage, and one
    if stamps do not tell the times of messages, so that the times of recording are taken instead.
    SourceError if there is no such topic; while iterating, if the recording is damaged.
    """

    def __init__(
        self,
        path: Path,
        topic: str,
        types: tuple[str, ...],
        option: str,
        reading: ReadingConfig = ReadingConfig(),
    ) -> None:
        self.storages, lines = open_storage(path, reading)
        self.warnings = Lines(lines)
        topics = merge_topics(storage.topics for storage in self.storages)
        self.chosen = choose_topic(path, topics, topic, types, option)
        self._path = path
        self._useless: str | None = None  # what is wrong with stamps; None while unknown

    def __iter__(self) -> Iterator[RawMessage]:
        if self.has_useless_stamps():
            yield from (
                message.without_stamp() if len(message.cdr) >= STAMP_END else message
                for message in self._recorded()
            )
        else:
            yield from self._recorded()

    def has_useless_stamps(self) -> bool:
        """Return whether the times of recording are taken; they are for the whole topic."""
        if self._useless is None:
            first: list[RawMessage] = []
            with suppress(SourceError):  # which is raised again where the damage is met
                first.extend(islice(self._recorded(), FIRST))
            stamps_ns = [message.header_stamp_ns for message in first]
            self._useless = useless(stamps_ns, [message.log_time_ns for message in first])
            if self._useless:
                self.warnings.append(
                    f'{self._path}: the first {len(first)} messages of {self.chosen.name} have '
                    f'{self._useless}; the times of recording are taken instead: check the driver'
                )
        return bool(self._useless)

    def _recorded(self) -> Iterator[RawMessage]:
        for storage in self.storages:
            for message in storage.messages(self.chosen.name, self.warnings.add):
                if message.type_name == self.chosen.type_name:
                    yield message


class Recording:
    """
    The images of a ROS 1 or ROS 2 recording, in the order in which they were recorded.

    The frame of a message that cannot be decoded has a `problem` and no image. `warnings`, one
    line each, grow while the recording is read. SourceError as in `TopicMessages`, and if the
    first image is of a format that is not read.
    """

    def __init__(
        self, path: Path, topic: str = '', reading: ReadingConfig = ReadingConfig()
    ) -> None:
        self._path, self._reading = path, reading
        self._messages = TopicMessages(path, topic, IMAGE_TYPES, '--topic', reading)
        self.name, self.warnings = printable(path.resolve().name), self._messages.warnings
        self.topic, self.type_name = self._messages.chosen.name, self._messages.chosen.type_name
        self._count = min(self._messages.chosen.count, sys.maxsize)
        for storage in self._messages.storages:
            if storage.damage:
                saved = storage.topics.get(self.topic)
                count = saved.count if saved else 0
                self.warnings.add(f'{storage.damage}; {count} frames of {self.topic} were saved')

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[Frame]:
        for number, message in enumerate(self._raw_messages()):
            try:
                pixels = message_pixels(message, self._reading)
            except ImageError as error:
                if isinstance(error, FormatError) and not number:
                    raise SourceError(f'{self._path}: images of {self.topic}: {error}') from None
                yield Frame(message.stamp_ns, None, self.topic, problem=str(error))
                continue
            if not (message.header_stamp_ns or self._messages.has_useless_stamps()):
                self.warnings.add(
                    f'{self._path}: images of {self.topic} carry no stamp; '
                    'the time of recording was taken instead'
                )
            gray = gray_of(pixels)
            yield Frame(message.stamp_ns, gray, self.topic, frame_id=message.frame_id)

    def messages(self) -> Iterator[RawMessage]:
        """Yield the image messages undecoded, as CDR, except for those that have no stamp."""
        return (message for message in self._raw_messages() if len(message.cdr) >= STAMP_END)

    def _raw_messages(self) -> Iterator[RawMessage]:
        count = 0
        for message in self._messages:
            count += 1
            yield message
        if not count:
            raise SourceError(
                f'{self._path}: none of the {self._count} images of {self.topic} that its index '
                'lists is there; record again'
            )
        if count != self._count:
            self.warnings.add(
                f'{self._path}: {count} images of {self.topic} were read, but its index lists '
                f'{self._count}; it may be damaged'
            )


def read_poses(
    path: Path,
    topic: str = '',
    reading: ReadingConfig = ReadingConfig(),
    frame: OdometryFrame | None = None,
    warnings: list[str] | None = None,
) -> list[tuple[int, Pose]]:
    """
    Return the stamped poses of a topic.

    The topic is of Odometry, PoseStamped or PoseWithCovarianceStamped; it may be left out if there
    is only one. Damaged and infinite poses are skipped; SourceError if none is left. With a
    `frame`, those of Odometry are carried to the base; `warnings` gets a line if some cannot be.
    """
    messages = TopicMessages(path, topic, POSE_TYPES, '--odom', reading)
    whole = sorted(filter(None, map(_pose, messages)), key=itemgetter(0))
    name = messages.chosen.name
    if not whole:
        raise SourceError(f'{path}: no pose of {name} is whole and finite; choose another topic')
    if frame is None:
        return [(stamp_ns, pose) for stamp_ns, pose, _ in whole]
    poses, left_out = [], list[str]()
    for stamp_ns, pose, child in whole:
        if carried := frame.carried(pose, child):
            poses.append((stamp_ns, carried))
        else:
            left_out.append(child)
    if left_out and warnings is not None:
        warnings.append(f'{name}: {frame.problem(left_out[0])}')
    return poses


def read_camera_in(
    path: Path,
    topic: str = '',
    reading: ReadingConfig = ReadingConfig(),
    warnings: list[str] | None = None,
) -> tuple[Camera, str]:
    """
    Return the first calibrated camera of a topic, and its optical frame; or SourceError.

    The topic may be left out if there is only one. `warnings` gets the line of `correction`, if
    there is one.
    """
    messages = TopicMessages(path, topic, CAMERA_TYPES, '--camera-info', reading)
    problem = 'K and P are zero, so it is not calibrated'
    for message in messages:
        try:
            info = decode(message)
            camera = camera_from_info(info)
        except (ImageError, SourceError) as error:
            problem = str(error)
            continue
        if camera:
            if warnings is not None and (line := correction(info, camera)):
                warnings.append(f'{path}: {messages.chosen.name}: {line}')
            return camera, info.header.frame_id
    raise SourceError(f'{path}: no camera of {messages.chosen.name} can be used: {problem}')


def read_static_transforms(
    path: Path, reading: ReadingConfig = ReadingConfig()
) -> StaticTransforms | None:
    """Return the static transforms of a recording; None if it has none."""
    storages, _ = open_storage(path, reading)
    recorded = [
        message
        for storage in storages
        for topic in storage.topics.values()
        if topic.count and topic.type_name in TF_TYPES and topic.name.endswith(_TF_STATIC)
        for message in storage.messages(topic.name)
    ]
    transforms = []
    for message in recorded:
        with suppress(ImageError):
            transforms.append(decode(message))
    return StaticTransforms(transforms) if transforms else None


def _pose(message: RawMessage) -> tuple[int, Pose, str] | None:
    """Return a stamp, a pose, and the frame that it is of, empty if it is not said."""
    try:
        decoded = decode(message)
    except ImageError:
        return None
    if message.type_name == POSE_TYPES[0]:
        pose = odometry_from_message(decoded)
    else:
        plain = decoded.pose if message.type_name == POSE_TYPES[1] else decoded.pose.pose
        pose = pose_from_message(plain)
    child = getattr(decoded, 'child_frame_id', '')
    return None if pose is None else (message.stamp_ns, pose, child)
