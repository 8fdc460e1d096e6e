# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What else than images a recording holds that a run can use."""

from collections.abc import Callable
from pathlib import Path
import sys
from typing import NamedTuple

from convseq_ros.errors import SourceError
from convseq_ros.reading_config import ReadingConfig
from convseq_ros.sources import open_source
from convseq_ros.sources.recording import read_camera, read_poses, Recording
from convseq_ros.sources.topics import CAMERA_TYPES, ODOMETRY_TYPES


class SideTopics(NamedTuple):
    """Topics of odometry and of the camera's description; empty for none."""

    odom: str = ''
    camera_info: str = ''


def side_topics(path: Path, reading: ReadingConfig = ReadingConfig()) -> SideTopics:
    """
    Return the topics of a recording that say where its frames were taken, and by which camera.

    One is left out, with a line on standard error, if several could be meant or what it says
    cannot be used. A folder of pictures has none.
    """
    source = open_source(path, reading=reading)
    if not isinstance(source, Recording):
        return SideTopics()
    return SideTopics(
        _usable(path, source.topics_of(ODOMETRY_TYPES), read_poses, reading),
        _usable(path, source.topics_of(CAMERA_TYPES), read_camera, reading),
    )


def _usable(
    path: Path,
    topics: list[str],
    read: Callable[[Path, str, ReadingConfig], object],
    reading: ReadingConfig,
) -> str:
    if len(topics) > 1:
        print(
            f'warning: {path}: left out {", ".join(topics)}: several could be meant',
            file=sys.stderr,
        )
    if len(topics) != 1:
        return ''
    try:
        read(path, topics[0], reading)
    except SourceError as error:
        print(f'warning: left out {topics[0]}: {error}', file=sys.stderr)
        return ''
    return topics[0]
