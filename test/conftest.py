# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What all tests share: a ROS that nobody else hears, and the data beside the repository."""

import atexit
import os
from pathlib import Path
import shutil
import sys
import tempfile

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]
HIGHEST_DOMAIN = 101
OVER_DDS = 'test_demo', 'test_live', 'test_parity'


def isolate_ros() -> None:
    """Keep this test run to itself and off other cores; must run before rclpy and NumPy do."""
    logs = tempfile.mkdtemp(prefix='convseq_ros_log_')
    atexit.register(shutil.rmtree, logs, ignore_errors=True)
    os.environ['ROS_LOG_DIR'] = logs
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    os.environ['ROS_DOMAIN_ID'] = str(1 + os.getpid() % HIGHEST_DOMAIN)
    os.environ.setdefault('AMENT_PREFIX_PATH', sys.prefix)
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')


isolate_ros()


@pytest.fixture(scope='session')
def shared_data() -> Path:
    """Return the folder of real recordings and published results; skip where there is none."""
    data = REPOSITORY.parent / 'shared' / 'data'
    if not data.is_dir():
        pytest.skip('needs the data sets in ../shared/data')
    return data


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Try again what two processes say over DDS: on a busy machine discovery may come late."""
    for item in items:
        if item.path.parent.name == 'node' or item.path.stem in OVER_DDS:
            item.add_marker(pytest.mark.flaky(reruns=2))
