# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is installed, as whoever helps wants to know it."""

from importlib import metadata
import os
import platform

from convseq_ros import __version__
from convseq_ros.core.compiled import library
import cv2
import numpy as np


def describe_installation() -> dict[str, str | int]:
    """Return versions, kernels and processor, by name; texts, and the number of cores."""
    found = library()
    return {
        'convseq_ros': __version__,
        'python': platform.python_version(),
        'numpy': np.__version__,
        'opencv': cv2.__version__,
        'rclpy': _version_of('rclpy'),
        'kernels': found.variant or f'numpy: {found.problem}',
        'machine': platform.machine(),
        'processor': _processor(),
        'cores': os.cpu_count() or 0,
        'system': platform.platform(),
        'ros': os.environ.get('ROS_DISTRO', ''),
        'rmw': os.environ.get('RMW_IMPLEMENTATION', ''),
    }


def _version_of(package: str) -> str:
    for name in (package, f'ros-{package}'):  # of apt's, and of PyPI's
        try:
            return metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return ''


def _processor() -> str:
    """Return the name that Linux has for the processor; empty if it has none, as on ARM."""
    with open('/proc/cpuinfo', encoding='utf-8', errors='replace') as file:
        named = (line.partition(':')[2].strip() for line in file if line.startswith('model name'))
        return next(named, '')
