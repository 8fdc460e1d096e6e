# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a process of ROS needs before it starts: settings of Fast DDS, a place for its logs."""

import os
from pathlib import Path
import sys
import tempfile

VARIABLE = 'FASTRTPS_DEFAULT_PROFILES_FILE'
LARGE_IMAGES = 'fastdds_large_images.xml'
QUICK_START = 'fastdds_quick_start.xml'
_CHOSEN_BY = VARIABLE, 'FASTDDS_DEFAULT_PROFILES_FILE'


def fast_dds(profile: str) -> dict[str, str]:
    """
    Return the variable with which a process uses one of our profiles.

    Empty if the user has chosen settings, or ours are not installed.

    Parameters
    ----------
    profile : str
        `LARGE_IMAGES`, to lose no large images, nor what is sent beside them, or `QUICK_START`, to
        find others at once. The first does what the second does, too.

    """
    beside = Path(__file__).resolve().parents[1]
    prefix = beside.parent.parent.parent
    for folder in (beside / 'config', prefix / 'share' / 'convseq_ros' / 'config'):
        if (folder / profile).is_file() and not any(name in os.environ for name in _CHOSEN_BY):
            return {VARIABLE: str(folder / profile)}
    return {}


def settle_logs() -> None:
    """Have ROS write its logs to a folder of its own where the home is read-only; it says so."""
    if 'ROS_LOG_DIR' in os.environ:
        return
    folder = Path(os.environ.get('ROS_HOME') or os.path.expanduser('~/.ros'), 'log')
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        os.environ['ROS_LOG_DIR'] = tempfile.mkdtemp(prefix='ros_log_')
        told = f'{folder}: {error.strerror}; ROS logs to {os.environ["ROS_LOG_DIR"]}'
        print(f'warning: {told}', file=sys.stderr)
