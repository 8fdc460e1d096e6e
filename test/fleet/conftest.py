# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A cluster of two processes for all tests of fleets, and drawn recordings."""

from pathlib import Path

from convseq_ros.cli import main
from convseq_ros.config import Config
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.fleet.cluster import Cluster, connected
from convseq_ros.sources import open_source
import cv2
import numpy as np
import pytest

FRAMES, DRIVEN = 8, 20
SETTINGS = '--keyframe-overlap', '1'


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


@pytest.fixture(scope='session')
def drives(tmp_path_factory):
    """Return a folder of three drives, their maps, one map of all, and a drive past two again."""
    folder, maps = tmp_path_factory.mktemp('drives'), tmp_path_factory.mktemp('maps')
    again = tmp_path_factory.mktemp('again')
    one, number = maps / 'all' / 'one.db', 0
    one.parent.mkdir()
    for drive in range(3):
        (folder / str(drive)).mkdir()
        for place in range(DRIVEN):
            rng = np.random.default_rng(100 * drive + place)
            picture = cv2.GaussianBlur(rng.integers(0, 256, (60, 80), np.uint8), (5, 5), 1.0)
            cv2.imwrite(str(folder / str(drive) / f'{place:03}.png'), picture)
            # Past the second at its speed, then past the third twice as fast.
            if drive == 1 or (drive == 2 and place % 2):
                noise = rng.normal(0, 12, picture.shape)
                noisy = np.clip(picture + noise, 0, 255).astype(np.uint8)
                cv2.imwrite(str(again / f'{number:03}.png'), noisy)
                number += 1
        name = str(folder / str(drive))
        append = ['--append'] if drive else []
        assert main(['build-map', name, str(maps / f'map_{drive}.db'), *SETTINGS]) == 0
        assert main(['build-map', name, str(one), *SETTINGS, *append]) == 0
    return maps, one, again


@pytest.fixture(scope='session')
def answers_of():
    """Return a way to get all that is said of each frame, and to do something before each."""

    def answers(recognizer, recording, then=None):
        """Return all that is said of each frame; do something before each."""
        found = []
        for number, frame in enumerate(open_source(recording)):
            if then:
                then(number)
            match = recognizer.process(frame)
            said = match.status, match.reason, match.candidates, match.sequence_length
            found.append((*said, match.pairs_scored, match.confidence, match.localization))
        return found

    return answers


@pytest.fixture(scope='session')
def expected(drives, answers_of):
    _, one, again = drives
    return answers_of(PlaceRecognizer(open_map(one), Config()), again)
