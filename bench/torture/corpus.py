# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Small valid files of every kind that the package reads; hostile files are made from them."""

from collections.abc import Callable, Iterable
import functools
from pathlib import Path
import tempfile
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
IMAGE = 'sensor_msgs/msg/Image'
Rows = Iterable[tuple[str, int, Any]]  # topic, time of recording, message
_FRAMES = 4
_START_NS, _STEP_NS = 1_700_000_000_000_000_000, 100_000_000
_PICTURES: dict[str, tuple[str, list[int]]] = {
    'jpeg': ('.jpg', []),
    'progressive': ('.jpg', [cv2.IMWRITE_JPEG_PROGRESSIVE, 1]),
    'png': ('.png', []),
    'bmp': ('.bmp', []),
    'tiff': ('.tiff', []),
    'ppm': ('.ppm', []),
    'webp': ('.webp', [cv2.IMWRITE_WEBP_QUALITY, 60]),
}


def gray(number: int = 0) -> np.ndarray:
    """Return a noise image."""
    noise = np.random.default_rng(number).integers(0, 256, (48, 64), np.uint8)
    return np.asarray(cv2.GaussianBlur(noise, (5, 5), 1.0))


def pictures() -> dict[str, tuple[str, bytes]]:
    """Return suffix and content of a file of every image format, by name."""
    colour = np.dstack([gray(0), gray(1), gray(2)])
    return {
        name: (suffix, cv2.imencode(suffix, colour, options)[1].tobytes())
        for name, (suffix, options) in _PICTURES.items()
    }


@functools.cache
def recordings() -> dict[str, tuple[str, dict[str, bytes]]]:
    """Return path and files of a recording of every kind; a single file has an empty name."""
    with tempfile.TemporaryDirectory() as folder:
        return {
            kind: (
                path.name,
                {file.name: file.read_bytes() for file in path.iterdir()}
                if path.is_dir()
                else {'': path.read_bytes()},
            )
            for kind, path in _written(Path(folder)).items()
        }


def _written(folder: Path) -> dict[str, Path]:
    rows = [
        ('/camera', _START_NS + number * _STEP_NS, message(number=number))
        for number in range(_FRAMES)
    ]
    sqlite, mcap = StoragePlugin.SQLITE3, StoragePlugin.MCAP
    return {
        'mcap zstd': write_mcap(folder / 'zstd.mcap', rows, CompressionType.ZSTD),
        'mcap lz4': write_mcap(folder / 'lz4.mcap', rows, CompressionType.LZ4),
        'mcap plain': write_mcap(folder / 'plain.mcap', rows),
        'mcap without chunks': write_mcap(folder / 'loose.mcap', rows, use_chunking=False),
        'db3': write_ros2(folder / 'db3', rows, sqlite) / 'db3.db3',
        'bag': write_ros1(folder / 'drive.bag', rows),
        'folder mcap': write_ros2(folder / 'storage', rows, mcap, CompressionMode.STORAGE),
        'folder messages': write_ros2(folder / 'each', rows, sqlite, CompressionMode.MESSAGE),
        'folder files': write_ros2(folder / 'whole', rows, sqlite, CompressionMode.FILE),
    }


def cdr(kind: str = IMAGE, number: int = 0) -> bytes:
    """Return a serialized message."""
    return bytes(ROS2.serialize_cdr(message(kind, number), kind))


def message(kind: str = IMAGE, number: int = 0) -> Any:
    """Return a message of a rosbags type."""
    types, picture = ROS2.types, gray(number)
    stamp = types['builtin_interfaces/msg/Time'](*divmod(_START_NS + number * _STEP_NS, 10**9))
    header = types['std_msgs/msg/Header'](stamp, 'camera')
    if kind == IMAGE:
        return types[kind](header, *picture.shape, 'mono8', 0, picture.shape[1], picture.ravel())
    if kind == 'sensor_msgs/msg/CompressedImage':
        return types[kind](header, 'jpeg', cv2.imencode('.jpg', picture)[1].ravel())
    if kind == 'sensor_msgs/msg/CameraInfo':
        k = np.array([50.0, 0, 32, 0, 50, 24, 0, 0, 1])
        p = np.array([50.0, 0, 32, 0, 0, 50, 24, 0, 0, 0, 1, 0])
        part = types['sensor_msgs/msg/RegionOfInterest'](0, 0, 0, 0, False)
        return types[kind](
            header, 48, 64, 'plumb_bob', np.zeros(5), k, np.eye(3).ravel(), p, 0, 0, part
        )
    point = types['geometry_msgs/msg/Point'](1.0, 2.0, 3.0)
    turn = types['geometry_msgs/msg/Quaternion'](0.0, 0.0, 0.6, 0.8)
    pose = types['geometry_msgs/msg/Pose'](point, turn)
    return types['geometry_msgs/msg/PoseStamped'](header, pose)


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
