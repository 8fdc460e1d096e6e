# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings written on the spot, in every storage and layout."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import cv2
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import get_typestore, Stores

ROS2 = get_typestore(Stores.ROS2_JAZZY)
ROS1 = get_typestore(Stores.ROS1_NOETIC)
LAYOUTS = (
    'mcap folder',
    'mcap file',
    'sqlite3 folder',
    'db3 file',
    'ros1 bag',
    'mcap zstd',
    'mcap lz4',
    'mcap without chunks',
    'mcap folder zstd',
    'sqlite3 folder compressed messages',
    'sqlite3 folder compressed file',
)
START_NS = 1_700_000_000_000_000_000
STEP_NS = 100_000_000


def header(stamp_ns):
    kinds = ROS2.types
    stamp = kinds['builtin_interfaces/msg/Time'](*divmod(stamp_ns, 10**9))
    return kinds['std_msgs/msg/Header'](stamp, 'camera')


def image(gray, stamp_ns=START_NS, **changes):
    """Return a mono8 Image message, with any field changed."""
    height, width = gray.shape
    message = ROS2.types['sensor_msgs/msg/Image'](
        header(stamp_ns), height, width, 'mono8', 0, width, gray.ravel()
    )
    return replace(message, **changes)


def compressed(gray, stamp_ns=START_NS, suffix='.png', name='png'):
    data = cv2.imencode(suffix, gray)[1].ravel()
    return ROS2.types['sensor_msgs/msg/CompressedImage'](header(stamp_ns), name, data)


def odometry(x, stamp_ns):
    kinds = ROS2.types
    pose = kinds['geometry_msgs/msg/Pose'](
        kinds['geometry_msgs/msg/Point'](x, 2.0, 3.0),
        kinds['geometry_msgs/msg/Quaternion'](0.0, 0.0, 0.6, 0.8),
    )
    covariance = np.zeros(36)
    zero = kinds['geometry_msgs/msg/Vector3'](0.0, 0.0, 0.0)
    return kinds['nav_msgs/msg/Odometry'](
        header(stamp_ns),
        'base',
        kinds['geometry_msgs/msg/PoseWithCovariance'](pose, covariance),
        kinds['geometry_msgs/msg/TwistWithCovariance'](
            kinds['geometry_msgs/msg/Twist'](zero, zero), covariance
        ),
    )


def text(content='hello'):
    return ROS2.types['std_msgs/msg/String'](content)


def image_drive(pictures, topic='/camera/image_raw'):
    """Return rows for `write_recording`: one image every 0.1 s, recorded 5 ms after its stamp."""
    return [
        (topic, START_NS + STEP_NS * i + 5_000_000, image(gray, START_NS + STEP_NS * i))
        for i, gray in enumerate(pictures)
    ]


def _write_ros2(folder, rows, plugin, compression=CompressionMode.NONE):
    writer = Ros2Writer(folder, version=9, storage_plugin=plugin)
    writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        connections = {}
        for topic, log_ns, message in rows:
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=ROS2)
            writer.write(connections[topic], log_ns, ROS2.serialize_cdr(message, kind))
    return folder


def _write_ros1(path, rows):
    with Ros1Writer(path) as writer:
        connections = {}
        for topic, log_ns, message in rows:
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=ROS1)
            data = ROS2.cdr_to_ros1(ROS2.serialize_cdr(message, kind), kind)
            writer.write(connections[topic], log_ns, data)
    return path


def _write_mcap(path, rows, compression=CompressionType.NONE, use_chunking=True, profile='ros2'):
    with path.open('wb') as file:
        writer = McapWriter(
            file, chunk_size=4096, compression=compression, use_chunking=use_chunking
        )
        writer.start(profile=profile)
        channels = {}
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


def write_recording(base: Path, layout: str, rows: list) -> Path:
    """Write (topic, log time, message) rows below a folder; return the path to open."""
    folder, file = base / 'drive', base / 'drive.mcap'
    mcap, sqlite = StoragePlugin.MCAP, StoragePlugin.SQLITE3
    return {
        'mcap folder': lambda: _write_ros2(folder, rows, mcap),
        'mcap file': lambda: _write_ros2(folder, rows, mcap) / 'drive.mcap',
        'mcap folder zstd': lambda: _write_ros2(folder, rows, mcap, CompressionMode.STORAGE),
        'sqlite3 folder': lambda: _write_ros2(folder, rows, sqlite),
        'db3 file': lambda: _write_ros2(folder, rows, sqlite) / 'drive.db3',
        'sqlite3 folder compressed messages': lambda: _write_ros2(
            folder, rows, sqlite, CompressionMode.MESSAGE
        ),
        'sqlite3 folder compressed file': lambda: _write_ros2(
            folder, rows, sqlite, CompressionMode.FILE
        ),
        'ros1 bag': lambda: _write_ros1(base / 'drive.bag', rows),
        'mcap zstd': lambda: _write_mcap(file, rows, CompressionType.ZSTD),
        'mcap lz4': lambda: _write_mcap(file, rows, CompressionType.LZ4),
        'mcap plain': lambda: _write_mcap(file, rows),
        'mcap without chunks': lambda: _write_mcap(file, rows, use_chunking=False),
        'mcap without profile': lambda: _write_mcap(file, rows, profile=''),
    }[layout]()


@pytest.fixture
def pictures() -> list:
    """Twelve grey pictures, each different."""
    rng = np.random.default_rng(3)
    return [rng.integers(0, 256, (24, 32), dtype=np.uint8) for _ in range(12)]


@pytest.fixture(params=LAYOUTS)
def layout(request) -> str:
    return request.param


@pytest.fixture
def recorder(tmp_path) -> SimpleNamespace:
    """Return what writes recordings and their messages."""
    return SimpleNamespace(
        write=lambda layout, rows, base=tmp_path: write_recording(base, layout, rows),
        image=image,
        compressed=compressed,
        odometry=odometry,
        text=text,
        drive=image_drive,
        ros2=ROS2,
        start_ns=START_NS,
        step_ns=STEP_NS,
    )
