# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings written on the spot, in every storage and layout."""

from pathlib import Path

import numpy as np
import pytest

# Whoever imports this is skipped where they are absent: apt has none of them.
for name in ('mcap', 'rosbags', 'zstandard'):
    pytest.importorskip(name, reason=f'needs {name}: pip install {name}')

from mcap.writer import CompressionType  # noqa: E402
from rosbags.rosbag2 import CompressionMode, StoragePlugin  # noqa: E402

from bench.recordings import (  # noqa: E402, F401
    compressed,
    drive,
    header,
    image,
    pose,
    ROS2,
    START_NS,
    STEP_NS,
    write_mcap,
    write_ros1,
    write_ros2,
)


def odometry(x, stamp_ns):
    kinds = ROS2.types
    covariance = np.zeros(36)
    zero = kinds['geometry_msgs/msg/Vector3'](0.0, 0.0, 0.0)
    return kinds['nav_msgs/msg/Odometry'](
        header(stamp_ns),
        'base',
        kinds['geometry_msgs/msg/PoseWithCovariance'](pose(x), covariance),
        kinds['geometry_msgs/msg/TwistWithCovariance'](
            kinds['geometry_msgs/msg/Twist'](zero, zero), covariance
        ),
    )


def camera_info(
    k,
    p=(0.0,) * 12,
    size=(32, 24),
    model='',
    d=(),
    stamp_ns=1,
    frame='camera',
    binning=(0, 0),
    roi=(0, 0, 0, 0),
):
    """Return a CameraInfo message, of K and P; the region of interest is x, y, height, width."""
    kinds = ROS2.types
    region = kinds['sensor_msgs/msg/RegionOfInterest'](*roi, False)
    numbers = (np.array(one, float) for one in (d, k, np.eye(3).ravel(), p))
    return kinds['sensor_msgs/msg/CameraInfo'](
        header(stamp_ns, frame), *size[::-1], model, *numbers, *binning, region
    )


def text(content='hello'):
    return ROS2.types['std_msgs/msg/String'](content)


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
        'mcap folder compressed messages': lambda: write_ros2(
            folder, rows, mcap, CompressionMode.MESSAGE
        ),
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
