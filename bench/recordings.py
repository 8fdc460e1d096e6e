# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of rosbags, and recordings of them, for tests and attacks."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
import numpy as np
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import get_typestore, Stores

ROS2, ROS1 = get_typestore(Stores.ROS2_JAZZY), get_typestore(Stores.ROS1_NOETIC)
START_NS, STEP_NS = 1_700_000_000_000_000_000, 100_000_000
Rows = Iterable[tuple[str, int, Any]]  # topic, time of recording, message


def gray(number: int = 0) -> np.ndarray:
    """Return a noise image."""
    noise = np.random.default_rng(number).integers(0, 256, (48, 64), np.uint8)
    return np.asarray(cv2.GaussianBlur(noise, (5, 5), 1.0))


def write_pictures(folder: Path, count: int) -> None:
    """Write a folder of noise images."""
    folder.mkdir()
    for number in range(count):
        cv2.imwrite(str(folder / f'{number}.png'), gray(number))


def drive(pictures: Iterable[np.ndarray], topic: str = '/camera/image_raw') -> Rows:
    """Return rows of a recording: an image every 0.1 s, recorded 5 ms after its stamp."""
    return [
        (topic, START_NS + STEP_NS * i + 5_000_000, image(gray, START_NS + STEP_NS * i))
        for i, gray in enumerate(pictures)
    ]


def header(stamp_ns: int = START_NS, frame_id: str = 'camera') -> Any:
    """Return a header of rosbags."""
    stamp = ROS2.types['builtin_interfaces/msg/Time'](*divmod(stamp_ns, 10**9))
    return ROS2.types['std_msgs/msg/Header'](stamp, frame_id)


def image(gray: np.ndarray, stamp_ns: int = START_NS, **changes: Any) -> Any:
    """Return a mono8 Image message, with any field changed."""
    kind, size = ROS2.types['sensor_msgs/msg/Image'], gray.shape
    plain: Any = kind(header(stamp_ns), *size, 'mono8', 0, size[1], gray.ravel())
    return replace(plain, **changes)


def compressed(
    gray: np.ndarray, stamp_ns: int = START_NS, suffix: str = '.png', name: str = 'png'
) -> Any:
    """Return a CompressedImage message."""
    data = cv2.imencode(suffix, gray)[1].ravel()
    return ROS2.types['sensor_msgs/msg/CompressedImage'](header(stamp_ns), name, data)


def camera_info() -> Any:
    """Return a CameraInfo message."""
    k = np.array([50.0, 0, 32, 0, 50, 24, 0, 0, 1])
    p = np.array([50.0, 0, 32, 0, 0, 50, 24, 0, 0, 0, 1, 0])
    part = ROS2.types['sensor_msgs/msg/RegionOfInterest'](0, 0, 0, 0, False)
    kind, eye = ROS2.types['sensor_msgs/msg/CameraInfo'], np.eye(3).ravel()
    return kind(header(), 48, 64, 'plumb_bob', np.zeros(5), k, eye, p, 0, 0, part)


def pose(x: float = 1.0) -> Any:
    """Return a Pose message."""
    point = ROS2.types['geometry_msgs/msg/Point'](x, 2.0, 3.0)
    turn = ROS2.types['geometry_msgs/msg/Quaternion'](0.0, 0.0, 0.6, 0.8)
    return ROS2.types['geometry_msgs/msg/Pose'](point, turn)


def write_mcap(
    path: Path,
    rows: Rows,
    compression: CompressionType = CompressionType.NONE,
    use_chunking: bool = True,
) -> Path:
    """Write a single mcap file, and return its path."""
    with path.open('wb') as file:
        writer = McapWriter(
            file, chunk_size=4096, compression=compression, use_chunking=use_chunking
        )
        writer.start(profile='ros2')
        channels: dict[str, int] = {}
        for topic, log_ns, message in rows:
            kind = message.__msgtype__
            if topic not in channels:
                definition, _ = ROS2.generate_msgdef(kind, ros_version=2)
                schema = writer.register_schema(kind, 'ros2msg', definition.encode())
                channels[topic] = writer.register_channel(topic, 'cdr', schema)
            data = bytes(ROS2.serialize_cdr(message, kind))
            writer.add_message(channels[topic], log_ns, data, log_ns)
        writer.finish()
    return path


def write_ros2(
    folder: Path,
    rows: Rows,
    plugin: StoragePlugin,
    compression: CompressionMode = CompressionMode.NONE,
) -> Path:
    """Write a recording like ROS 2, and return its folder."""
    writer = Ros2Writer(folder, version=9, storage_plugin=plugin)
    writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        _write(writer, rows, ROS2, ROS2.serialize_cdr)
    return folder


def write_ros1(path: Path, rows: Rows) -> Path:
    """Write a recording like ROS 1, and return its path."""

    def serialized(message: Any, kind: str) -> Any:
        return ROS2.cdr_to_ros1(ROS2.serialize_cdr(message, kind), kind)

    with Ros1Writer(path) as writer:
        _write(writer, rows, ROS1, serialized)
    return path


def _write(writer: Any, rows: Rows, types: Any, serialize: Callable[[Any, str], Any]) -> None:
    connections: dict[str, Any] = {}
    for topic, log_ns, message in rows:
        kind = message.__msgtype__
        if topic not in connections:
            connections[topic] = writer.add_connection(topic, kind, typestore=types)
        writer.write(connections[topic], log_ns, serialize(message, kind))
