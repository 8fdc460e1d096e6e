# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A cluster of two processes for all tests of fleets, and drawn recordings."""

from pathlib import Path

from convseq_ros.cli import main
from convseq_ros.config import Config
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.fleet.cluster import started
from convseq_ros.sources import open_source
import numpy as np
from pictures import picture, written
import pytest

FRAMES = 20
SETTINGS = '--keyframe-overlap', '1', '--keep-images-px', '40'


@pytest.fixture(scope='session')
def workers():
    pytest.importorskip('distributed', reason='needs dask.distributed, the extra `fleet`')
    with started(2) as opened:
        yield opened


@pytest.fixture
def client(workers):
    yield workers
    # What a test killed is up again before another test takes packages away.
    workers.wait_for_workers(2, timeout=60)


@pytest.fixture(scope='session')
def recordings(tmp_path_factory) -> Path:
    """Return a folder of three folders of pictures, of other places each."""
    folder = tmp_path_factory.mktemp('recordings')
    for drive in range(3):
        places = range(100 * drive, 100 * drive + FRAMES)
        written(folder / f'drive_{drive}', map(picture, places))
    return folder


@pytest.fixture(scope='session')
def drives(recordings, tmp_path_factory):
    """Return a folder of three maps, one map of all, and a drive past two of them again."""
    maps, rng = tmp_path_factory.mktemp('maps'), np.random.default_rng(0)
    one = maps / 'all' / 'one.db'
    one.parent.mkdir()
    for drive in range(3):
        name, append = str(recordings / f'drive_{drive}'), ['--append'] if drive else []
        assert main(['build-map', name, str(maps / f'map_{drive}.db'), *SETTINGS]) == 0
        assert main(['build-map', name, str(one), *SETTINGS, *append]) == 0
    # Past the second at its speed, then past the third twice as fast.
    shown = map(picture, [*range(100, 100 + FRAMES), *range(201, 200 + FRAMES, 2)])
    noisy = (np.clip(one + rng.normal(0, 12, one.shape), 0, 255).astype(np.uint8) for one in shown)
    return maps, one, written(tmp_path_factory.mktemp('again') / 'drive', noisy)


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
