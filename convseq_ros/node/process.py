# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How this package's processes use threads, logs and Fast DDS."""

import os
from pathlib import Path
import sys
import tempfile

# Settings of Fast DDS that come with this package; other middlewares do not read them.
VARIABLE = 'FASTRTPS_DEFAULT_PROFILES_FILE'
LARGE_IMAGES = 'fastdds_large_images.xml'
QUICK_START = 'fastdds_quick_start.xml'
_CHOSEN_BY = VARIABLE, 'FASTDDS_DEFAULT_PROFILES_FILE'

# Threads of BLAS and of OpenCV busy-wait for each other: on a busy machine a pair of images takes
# ten times as long, and on a quiet one small images are not faster with several threads.
_THREAD_COUNTS = 'OPENBLAS_NUM_THREADS', 'OPENCV_FOR_THREADS_NUM'


def use_one_thread() -> None:
    """Limit BLAS and OpenCV, imported later, to one thread unless the environment sets more."""
    for name in _THREAD_COUNTS:
        os.environ.setdefault(name, '1')


def fast_dds(profile: str) -> dict[str, str]:
    """
    Return the environment variable with which a process uses one of our profiles.

    Empty if the user has chosen a profile, or ours are not installed. With `LARGE_IMAGES` neither
    large images nor messages beside them are lost. Both profiles discover others at once.
    """
    beside = Path(__file__).resolve().parents[2]
    prefix = beside.parent.parent.parent
    for folder in (beside / 'config', prefix / 'share' / 'convseq_ros' / 'config'):
        if (folder / profile).is_file() and not any(name in os.environ for name in _CHOSEN_BY):
            return {VARIABLE: str(folder / profile)}
    return {}


def check_logs() -> None:
    """Make ROS log to a temporary folder, with a warning, if it has no writable one."""
    if 'ROS_LOG_DIR' in os.environ:
        return
    home, folder = os.environ.get('HOME'), os.environ.get('ROS_HOME')
    if not (home or folder):
        problem = 'HOME is not set'
    else:
        logs = Path(folder or f'{home}/.ros', 'log')
        try:
            logs.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=logs).close()
            return
        except OSError as error:
            problem = f'{logs}: {error.strerror}'
    os.environ['ROS_LOG_DIR'] = tempfile.mkdtemp(prefix='ros_log_')
    print(f'warning: {problem}; ROS logs to {os.environ["ROS_LOG_DIR"]}', file=sys.stderr)
