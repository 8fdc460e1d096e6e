# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What all tests share: a ROS that nobody else hears, and the data beside the repository."""

import atexit
import contextlib
from importlib.machinery import PathFinder
import os
from pathlib import Path
import shutil
import sys
import tempfile
import warnings

import hypothesis
import pytest

REPOSITORY = Path(__file__).resolve().parents[1]


def prefer_installed() -> None:
    """Test what is installed: `python -m pytest`, which colcon runs, puts the sources first."""
    if Path(sys.path[0]).resolve() == REPOSITORY:
        if PathFinder.find_spec('convseq_ros', sys.path[1:]):
            del sys.path[0]


def isolate_ros() -> None:
    """Keep this test run to itself and off other cores; must run before rclpy and NumPy do."""
    logs = tempfile.mkdtemp(prefix='convseq_ros_log_')
    atexit.register(shutil.rmtree, logs, ignore_errors=True)
    os.environ['ROS_LOG_DIR'] = logs
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    os.environ.setdefault('AMENT_PREFIX_PATH', sys.prefix)
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    from convseq_ros.cli.processes import own_domain

    # Each worker of pytest-xdist is a process, and so has a domain that no other one has.
    os.environ['ROS_DOMAIN_ID'] = str(own_domain())


prefer_installed()
isolate_ros()
# A library that message packages load at their first use is not clean itself.
with contextlib.suppress(ImportError), warnings.catch_warnings():
    warnings.simplefilter('ignore')
    import rosidl_generator_py  # noqa: F401
# What several tests share, and the bench; the package, before it, where it is installed.
sys.path += [str(Path(__file__).parent), str(REPOSITORY)]
# How long an example takes, to be drawn or to run, says more of the machine than of us.
PATIENT = {'deadline': None, 'suppress_health_check': [hypothesis.HealthCheck.too_slow]}
hypothesis.settings.register_profile('patient', **PATIENT)
# What is asked a hundred times with one set of versions is asked again with another.
hypothesis.settings.register_profile('few', **PATIENT, max_examples=30)
hypothesis.settings.load_profile('patient')


WAITING = 'test/node', 'test/examples', 'test/fleet', 'test/bench/test_bench', 'test/test_parity'


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with tests that wait for other processes: beside them the core has others to do."""
    items.sort(key=lambda item: not item.nodeid.startswith(WAITING))


@pytest.fixture(scope='session')
def shared_data() -> Path:
    """Return the folder of real recordings and published results; skip where there is none."""
    data = REPOSITORY.parent / 'shared' / 'data'
    if not data.is_dir():
        pytest.skip('needs the data sets in ../shared/data')
    return data
