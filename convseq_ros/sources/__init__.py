# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where frames come from: folders of pictures, ROS recordings and videos."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from convseq_ros.errors import SourceError
from convseq_ros.reading_config import ReadingConfig
from convseq_ros.regular_file import refuse_irregular
from convseq_ros.sources.annotated import AnnotatedFrames, CameraOf, SeveralCameras
from convseq_ros.sources.annotated import Source as Source
from convseq_ros.sources.camera_info import read_camera_file
from convseq_ros.sources.depth import DEPTH_TYPES, DepthAt, DepthFolder, DepthTopic
from convseq_ros.sources.folder import ImageFolder, natural_key, pictures_in
from convseq_ros.sources.nav_sat import FIXES_GAP_NS
from convseq_ros.sources.pose_file import PoseAt, read_pose_file
from convseq_ros.sources.pose_track import PoseTrack
from convseq_ros.sources.recording import messages_of, read_camera, read_poses_in, Recording
from convseq_ros.sources.storage import is_storage_file
from convseq_ros.sources.video import Video, VIDEO_SUFFIXES


def open_source(path: Path, topic: str = '', reading: ReadingConfig = ReadingConfig()) -> Source:
    """
    Open a folder of pictures, a recording or a video, whichever is there.

    A recording is a .mcap, .db3 or .bag file, or a folder that a ROS 2 recorder wrote; `topic` is
    its image topic, if it has several. SourceError if the path is neither, is damaged, is no
    regular file, or holds no images.
    """
    path = Path(path)
    refuse_irregular(path)
    if path.suffix.lower() in VIDEO_SUFFIXES and not path.is_dir():
        _refuse_topic(path, 'a video', topic)
        return Video(path, reading)
    if not path.is_dir() or holds_recording(path):
        return Recording(path, topic, reading)
    _refuse_topic(path, 'a folder of pictures', topic)
    return ImageFolder(path, reading)


def open_annotated(
    path: Path,
    topic: str = '',
    odom: str = '',
    camera_info: str = '',
    poses: Path | str | None = None,
    reading: ReadingConfig = ReadingConfig(),
    depth: str = '',
) -> Source:
    """
    Open what `open_source` does, with what other topics, or files, say of its frames.

    `odom` is a topic of odometry, poses or satellite fixes, or `poses` a file as for
    `read_pose_file`: frames then know where they were taken. `camera_info` is a topic that
    describes the camera, or a file as for `read_camera_file`; `depth` a topic of depth images that
    are registered to the camera, or a folder of them. SourceError if one cannot be read.
    """
    source = open_source(path, topic, reading)
    if odom and poses:
        raise SourceError(f'poses of topic {odom} or of file {poses}: give one of them')
    if not (odom or poses or camera_info or depth):
        return source
    pose_at: PoseAt | None = None
    frame = ''
    if poses:
        pose_at = read_pose_file(Path(poses), len(source), reading)
    elif odom:
        stamped, frame = read_poses_in(path, odom, reading)
        track = PoseTrack(stamped, longest_gap_ns=FIXES_GAP_NS if frame else None)
        pose_at = lambda _index, stamp_ns: track.at(stamp_ns)  # noqa: E731
    is_folder = path.is_dir() and not holds_recording(path)
    camera_of: CameraOf | None = None
    if (file := Path(camera_info)).is_file():
        camera_of = partial(read_camera_file, file, reading=reading)
    elif camera_info and is_folder:
        raise SourceError(f'{file}: no such file; a folder of pictures has no topics')
    elif camera_info:
        camera = read_camera(path, camera_info, reading)
        camera_of = lambda _height, _width: camera  # noqa: E731
    depth_at: DepthAt | None = None
    if depth and (Path(depth).is_dir() or is_folder):
        depth_at = DepthFolder(Path(depth), reading, source.warnings)
    elif depth:
        sought = path, depth, DEPTH_TYPES, '--depth', reading
        topic, _ = messages_of(*sought)
        depth_at = DepthTopic(lambda: messages_of(*sought)[1], topic, reading, source.warnings)
    return AnnotatedFrames(source, pose_at, camera_of, frame, depth_at)


def open_each_camera(
    path: Path,
    topics: str = '',
    camera_info: str = '',
    depth: str = '',
    reading: ReadingConfig = ReadingConfig(),
    **poses: Any,
) -> list[Source]:
    """Open what `open_annotated` does for each of the topics; depth is of the first."""
    names, infos = topics.split() or [''], camera_info.split()
    if len(names) == 1:
        infos = [camera_info]
    if len(set(names)) < len(names):
        raise SourceError(f'--topic {topics!r}: names a camera twice; name each once')
    if infos and len(infos) != len(names):
        raise SourceError(
            f'--camera-info: {len(infos)} for {len(names)} cameras; name one of each, in order'
        )
    depths = [depth, *[''] * (len(names) - 1)]
    return [
        open_annotated(path, name, camera_info=info, depth=own, reading=reading, **poses)
        for name, info, own in zip(names, infos or [''] * len(names), depths, strict=True)
    ]


def in_order(cameras: Sequence[Source]) -> Source:
    """Return sources of at least one camera as one, which yields the frames of all in order."""
    return SeveralCameras(list(cameras)) if len(cameras) > 1 else cameras[0]


def _refuse_topic(path: Path, what: str, topic: str) -> None:
    if topic:
        raise SourceError(f'{path}: {what} has no topic {topic!r}; leave it out')


def recordings_in(folder: Path) -> list[Path]:
    """Return the recordings, videos and folders of pictures in a folder, bag2 before bag10."""
    refuse_irregular(folder)
    try:
        found = sorted(folder.iterdir(), key=natural_key)
        if pictures_in(folder) or folder / 'metadata.yaml' in found:
            raise SourceError(f'{folder}: is a recording itself; name the folder that it lies in')
    except OSError as error:
        raise SourceError(f'{folder}: {error.strerror}; check the path') from None
    recordings = [one for one in found if not one.name.startswith('.') and _is_recording(one)]
    if not recordings:
        raise SourceError(
            f'{folder}: no recordings in it: no .mcap, .db3, .bag or video, no folder of pictures'
        )
    return recordings


def _is_recording(path: Path) -> bool:
    if path.is_dir():
        return holds_recording(path) or bool(pictures_in(path))
    return is_storage_file(path) or path.suffix.lower() in VIDEO_SUFFIXES


def holds_recording(folder: Path) -> bool:
    """Return whether a folder is what a recorder wrote; SourceError if it cannot be read."""
    try:
        files = list(folder.iterdir())
        pictures = pictures_in(folder)
    except OSError as error:
        raise SourceError(f'{folder}: {error.strerror}; check its permissions') from None
    described = folder / 'metadata.yaml' in files
    recorded = any(is_storage_file(file) for file in files)
    return (recorded and described) or (not pictures and (recorded or described))
