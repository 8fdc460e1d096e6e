# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What to type when something is not installed, from wherever the user is."""

from pathlib import Path
import sys
import sysconfig


def pip_install(*packages: str) -> str:
    """
    Return a command that installs packages of PyPI into the Python that runs.

    Ubuntu's own Python is managed by apt; pip adds to it only when told.
    """
    names = ' '.join(f"'{name}'" if '[' in name else name for name in packages)
    managed = Path(sysconfig.get_path('stdlib'), 'EXTERNALLY-MANAGED').is_file()
    if managed and sys.prefix == sys.base_prefix:
        return f'pip install --break-system-packages {names}, or without that word in a venv'
    return f'pip install {names}'


NEEDS_ROS = (
    'ROS 2 is not installed or not sourced: source /opt/ros/jazzy/setup.bash, or '
    + pip_install('ros-jazzy-rclpy[fastrtps]', 'ros-jazzy-common-interfaces')
)
