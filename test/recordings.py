# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings written on the spot, in every storage and layout."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

# Whoever imports this is skipped where they are absent: apt has none of them.
for name in ('mcap', 'rosbags', 'zstandard'):
    pytest.importorskip(name, reason=f'needs {name}: pip install {name}')

from mcap.writer import CompressionType  # noqa: E402
from rosbags.rosbag2 import CompressionMode, StoragePlugin  # noqa: E402

from bench.torture.corpus import ROS2, write_mcap, write_ros1, write_ros2  # noqa: E402

START_NS = 1_700_000_000_000_000_000
STEP_NS = 100_000_000


def header(stamp_ns, frame_id='camera'):
    kinds = ROS2.types
    stamp = kinds['builtin_interfaces/msg/Time'](*divmod(stamp_ns, 10**9))
    return kinds['std_msgs/msg/Header'](stamp, frame_id)


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


def drive(pictures, topic='/camera/image_raw'):
    """Return rows for `write_recording`: one image every 0.1 s, recorded 5 ms after its stamp."""
    return [
        (topic, START_NS + STEP_NS * i + 5_000_000, image(gray, START_NS + STEP_NS * i))
        for i, gray in enumerate(pictures)
    ]


def write_recording(base: Path, layout: str, rows: list) -> Path:
    """Write (topic, log time, message) rows below a folder; return the path to open."""
    folder, file = base / 'drive', base / 'drive.mcap'
    mcap, sqlite = StoragePlugin.MCAP, StoragePlugin.SQLITE3
    return {
        'mcap folder': lambda: write_ros2(folder, rows, mcap),
        'mcap file': lambda: write_ros2(folder, rows, mcap) / 'drive.mcap',
        'mcap folder zstd': lambda: write_ros2(folder, rows, mcap, CompressionMode.STORAGE),
        'sqlite3 folder': lambda: write_ros2(folder, rows, sqlite),
        'db3 file': lambda: write_ros2(folder, rows, sqlite) / 'drive.db3',
        'sqlite3 folder compressed messages': lambda: write_ros2(
            folder, rows, sqlite, CompressionMode.MESSAGE
        ),
        'sqlite3 folder compressed file': lambda: write_ros2(
            folder, rows, sqlite, CompressionMode.FILE
        ),
        'ros1 bag': lambda: write_ros1(base / 'drive.bag', rows),
        'mcap zstd': lambda: write_mcap(file, rows, CompressionType.ZSTD),
        'mcap lz4': lambda: write_mcap(file, rows, CompressionType.LZ4),
        'mcap plain': lambda: write_mcap(file, rows),
        'mcap without chunks': lambda: write_mcap(file, rows, use_chunking=False),
    }[layout]()
