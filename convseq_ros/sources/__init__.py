# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where frames come from: folders of pictures, ROS recordings and videos."""

from collections.abc import Sequence
from functools import cache, partial
from itertools import starmap
from pathlib import Path
from typing import Any

from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.core.types import Pose
from convseq_ros.errors import SourceError
from convseq_ros.io.regular_file import refuse_irregular
from convseq_ros.sources.annotated_frames import AnnotatedFrames, CameraOf
from convseq_ros.sources.camera_info import read_camera_file
from convseq_ros.sources.folder import ImageFolder
from convseq_ros.sources.mount import (
    as_parameter,
    mount_of,
    OdometryFrame,
    StaticTransforms,
    Tf,
    told_mount,
)
from convseq_ros.sources.pose_file import PoseAt, read_pose_file
from convseq_ros.sources.pose_track import axes_problem, PoseTrack
from convseq_ros.sources.recording import (
    read_camera_in,
    read_poses,
    read_static_transforms,
    Recording,
)
from convseq_ros.sources.recording_names import holds_recording
from convseq_ros.sources.source import SeveralCameras
from convseq_ros.sources.source import Source as Source  # public here
from convseq_ros.sources.video import Video, VIDEO_SUFFIXES


def open_source(
    path: Path | str,
    topic: str = '',
    reading: ReadingConfig = ReadingConfig(),
    rate_hz: float | None = None,
) -> Source:
    """
    Open a folder of pictures, a recording or a video; SourceError if the path is none of them.

    A recording is a .mcap, .db3 or .bag file, or a folder that a ROS 2 recorder wrote; `topic` is
    its image topic, if it has several. `rate_hz` is that of a folder of pictures, 0.001 to 1000.
    """
    path = Path(path)
    refuse_irregular(path)
    if rate_hz is not None and (not path.is_dir() or holds_recording(path)):
        raise SourceError(f'{path}: has times of its own; leave out --rate {rate_hz:g}')
    if path.suffix.lower() in VIDEO_SUFFIXES and not path.is_dir():
        _refuse_topic(path, 'a video', topic)
        return Video(path, reading)
    if not path.is_dir() or holds_recording(path):
        return Recording(path, topic, reading)
    _refuse_topic(path, 'a folder of pictures', topic)
    return ImageFolder(path, reading, rate_hz)


def open_annotated(
    path: Path | str,
    topic: str = '',
    odom: str = '',
    camera_info: str = '',
    poses: Path | str | None = None,
    reading: ReadingConfig = ReadingConfig(),
    tf: Tf = Tf(),
    rate_hz: float | None = None,
    pose_axes: str = '',
) -> Source:
    """
    Open a source as `open_source`, with poses and camera from topics or files.

    `odom` is a topic of poses, `poses` a text file of them, as TUM or KITTI write it, or a folder
    with one for each image, in `pose_axes` as `read_pose_file` has them; `camera_info` a topic, or
    a file of `read_camera_file`. Where the camera is on the robot is read from /tf_static of a
    recording, as `tf` says. SourceError if any of them cannot be read.
    """
    path = Path(path)
    source = open_source(path, topic, reading, rate_hz)
    if odom and poses:
        raise SourceError(f'poses of topic {odom} or of file {poses}: give one of them')
    if not (odom or poses or camera_info):
        return source
    pose_at = _poses(source, path, odom, poses, reading, tf, pose_axes)
    is_folder = path.is_dir() and not holds_recording(path)
    camera_of: CameraOf | None = None
    optical_frame = ''
    if (file := Path(camera_info)).is_file():
        camera_of = partial(read_camera_file, file, reading=reading, warnings=source.warnings)
    elif camera_info and is_folder:
        raise SourceError(f'{file}: no such file; a folder of pictures has no topics')
    elif camera_info:
        camera, optical_frame = read_camera_in(path, camera_info, reading, source.warnings)
        camera_of = lambda _height, _width: camera  # noqa: E731
    mount = None
    if camera_of and isinstance(source, Recording):
        mount = _mount(source, path, optical_frame, tf, reading)
    poses_of = str(odom or poses) if pose_at else ''
    return AnnotatedFrames(source, pose_at, camera_of, poses_of, mount)


def _poses(
    source: Source,
    path: Path,
    odom: str,
    poses: Path | str | None,
    reading: ReadingConfig,
    tf: Tf,
    axes: str,
) -> PoseAt | None:
    """Return the poses of a source's frames, of a file or of a topic; None if there are none."""
    if poses:
        pose_at = read_pose_file(Path(poses), len(source), reading, source.warnings, axes)
        _refuse_other_times(source, pose_at, Path(poses))
        return pose_at
    if not odom:
        return None

    @cache
    def transforms() -> StaticTransforms:
        return read_static_transforms(path, reading) or StaticTransforms(())

    frame = OdometryFrame(
        tf.base_frame,
        lambda child: transforms().pose_in(child, tf.base_frame),
        lambda line: tf.tell(f'{path}: {odom}: {line}'),
    )
    stamped = read_poses(path, odom, reading, frame, source.warnings)
    if line := axes_problem(pose for _, pose in stamped):
        source.warnings.append(f'{odom}: {line}; convert them (docs/FILES.md)')
    track = PoseTrack(stamped)
    if track.problem:
        source.warnings.append(f'{odom}: {track.problem}')
    return None if track.last_stamp_ns is None else lambda _index, stamp_ns: track.at(stamp_ns)


def _mount(
    source: Recording, path: Path, optical_frame: str, tf: Tf, reading: ReadingConfig
) -> Pose | None:
    """Return the mount of a camera by /tf_static, and tell it; None if it is unknown or given."""
    transforms = read_static_transforms(path, reading)
    if transforms is None:
        if tf.base_frame != Tf().base_frame:
            tf.tell(f'{path}: has no /tf_static; --base-frame {tf.base_frame} is not used')
        return None
    if not optical_frame and (first := next(source.messages(), None)):
        optical_frame = first.frame_id
    if not optical_frame:
        return None
    lens = transforms.pose_in(tf.base_frame, optical_frame)
    if lens is None:
        said = '' if tf.camera_to_base else '; name another --base-frame, or give --camera-to-base'
        tf.tell(f'{path}: /tf_static has no way from {tf.base_frame} to {optical_frame}{said}')
        return None
    if tf.camera_to_base:
        at = f'"{as_parameter(mount_of(lens))}"'
        placed = f'/tf_static places {optical_frame} at {at} in {tf.base_frame}'
        tf.tell(f'{path}: {placed}; camera_to_base was given and counts')
        return None
    mount, line = told_mount(lens, optical_frame, tf.base_frame, '/tf_static')
    tf.tell(f'{path}: {line}')
    return mount


def _refuse_other_times(source: Source, pose_at: PoseAt, poses: Path) -> None:
    """Raise a SourceError if pictures, whose times are known before they are read, get no pose."""
    stamps_ns = source.stamps_ns if isinstance(source, ImageFolder) else []
    if stamps_ns and not any(starmap(pose_at, enumerate(stamps_ns))):
        first_s, last_s = stamps_ns[0] / 1e9, stamps_ns[-1] / 1e9
        raise SourceError(
            f'{poses}: has no pose at the times of the images of {source.name}, {first_s:.3f} to '
            f'{last_s:.3f} s; name them by their times, as 1305031102.175304.png, or give a pose '
            'for each (KITTI)'
        )


def open_each_camera(
    path: Path | str,
    topics: str = '',
    camera_info: str = '',
    reading: ReadingConfig = ReadingConfig(),
    **poses: Any,
) -> list[Source]:
    """Open a source as `open_annotated` for each of the topics."""
    names, infos = topics.split() or [''], camera_info.split()
    if len(names) == 1:
        infos = [camera_info]
    if len(set(names)) < len(names):
        raise SourceError(f'--topic {topics!r}: names a camera twice; name each once')
    if infos and len(infos) != len(names):
        raise SourceError(
            f'--camera-info: {len(infos)} for {len(names)} cameras; name one of each, in order'
        )
    return [
        open_annotated(path, name, camera_info=info, reading=reading, **poses)
        for name, info in zip(names, infos or [''] * len(names), strict=True)
    ]


def in_order(cameras: Sequence[Source]) -> Source:
    """Return one source, which yields the frames of at least one camera in order of time."""
    return SeveralCameras(list(cameras)) if len(cameras) > 1 else cameras[0]


def _refuse_topic(path: Path, what: str, topic: str) -> None:
    if topic:
        raise SourceError(f'{path}: {what} has no topic {topic!r}; leave it out')
