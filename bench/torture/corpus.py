# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Small files of every kind that is read, all whole; what is hostile is made of them."""

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
    """Return a picture of some noise."""
    noise = np.random.default_rng(number).integers(0, 256, (48, 64), np.uint8)
    return np.asarray(cv2.GaussianBlur(noise, (5, 5), 1.0))


def pictures() -> dict[str, tuple[str, bytes]]:
    """Return a suffix and a content for every kind of picture."""
    colour = np.dstack([gray(0), gray(1), gray(2)])
    return {
        name: (suffix, cv2.imencode(suffix, colour, options)[1].tobytes())
        for name, (suffix, options) in _PICTURES.items()
    }


@functools.cache
def recordings() -> dict[str, tuple[str, dict[str, bytes]]]:
    """Return the name and the files of a recording of every kind; the only one has no name."""
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
    return {
        'mcap zstd': _mcap(folder / 'zstd.mcap', CompressionType.ZSTD),
        'mcap lz4': _mcap(folder / 'lz4.mcap', CompressionType.LZ4),
        'mcap plain': _mcap(folder / 'plain.mcap', CompressionType.NONE),
        'mcap without chunks': _mcap(folder / 'loose.mcap', CompressionType.NONE, False),
        'db3': _ros2(folder / 'db3', StoragePlugin.SQLITE3) / 'db3.db3',
        'bag': _ros1(folder / 'drive.bag'),
        'folder mcap': _ros2(folder / 'storage', StoragePlugin.MCAP, CompressionMode.STORAGE),
        'folder messages': _ros2(folder / 'each', StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
        'folder files': _ros2(folder / 'whole', StoragePlugin.SQLITE3, CompressionMode.FILE),
    }


def cdr(kind: str = IMAGE, number: int = 0) -> bytes:
    """Return a message as it travels."""
    return bytes(ROS2.serialize_cdr(message(kind, number), kind))


def message(kind: str = IMAGE, number: int = 0) -> Any:
    """Return a message of rosbags."""
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


def _mcap(path: Path, compression: CompressionType, use_chunking: bool = True) -> Path:
    with path.open('wb') as file:
        writer = McapWriter(
            file, chunk_size=4096, compression=compression, use_chunking=use_chunking
        )
        writer.start(profile='ros2')
        definition, _ = ROS2.generate_msgdef(IMAGE, ros_version=2)
        schema = writer.register_schema(IMAGE, 'ros2msg', definition.encode())
        channel = writer.register_channel('/camera', 'cdr', schema)
        for number in range(_FRAMES):
            stamp_ns = _START_NS + number * _STEP_NS
            writer.add_message(channel, stamp_ns, cdr(number=number), stamp_ns)
        writer.finish()
    return path


def _ros2(
    folder: Path, plugin: StoragePlugin, compression: CompressionMode = CompressionMode.NONE
) -> Path:
    writer = Ros2Writer(folder, version=9, storage_plugin=plugin)
    writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection('/camera', IMAGE, typestore=ROS2)
        for number in range(_FRAMES):
            content = ROS2.serialize_cdr(message(number=number), IMAGE)
            writer.write(connection, _START_NS + number * _STEP_NS, content)
    return folder


def _ros1(path: Path) -> Path:
    with Ros1Writer(path) as writer:
        connection = writer.add_connection('/camera', IMAGE, typestore=ROS1)
        for number in range(_FRAMES):
            content = ROS2.cdr_to_ros1(ROS2.serialize_cdr(message(number=number), IMAGE), IMAGE)
            writer.write(connection, _START_NS + number * _STEP_NS, content)
    return path
