# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A cluster of two processes for all tests of fleets, and drawn recordings."""

from pathlib import Path

from convseq_ros.fleet.cluster import Cluster, connected
import cv2
import numpy as np
import pytest

FRAMES = 12


@pytest.fixture(scope='session')
def client():
    pytest.importorskip('distributed', reason='needs dask.distributed, the extra `fleet`')
    with connected(Cluster(workers=2)) as opened:
        yield opened


@pytest.fixture(scope='session')
def scheduler(client):
    return client.scheduler.address


@pytest.fixture(scope='session')
def recordings(tmp_path_factory) -> Path:
    """Return a folder of three folders of pictures, of other places each."""
    folder = tmp_path_factory.mktemp('recordings')
    for drive in range(3):
        (folder / f'drive_{drive}').mkdir()
        for number in range(FRAMES):
            rng = np.random.default_rng(100 * drive + number)
            picture = cv2.GaussianBlur(rng.integers(0, 256, (60, 80), np.uint8), (5, 5), 1.0)
            cv2.imwrite(str(folder / f'drive_{drive}' / f'{number:03}.png'), picture)
    return folder
