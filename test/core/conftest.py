# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Drawn places for tests of the whole pipeline, and maps of which only the places matter."""

from collections.abc import Callable

from convseq_ros.config import EncodingConfig
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.map.format import MapSession
from convseq_ros.core.map.place import pack_cells, Place
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Descriptor, Pose
from measured_pose import drawn_street
import numpy as np
from pictures import scene
import pytest

AHEAD = (0.0, 0.0, 0.0, 1.0)
SECOND_NS = 10**9


@pytest.fixture(scope='session')
def image() -> Callable[..., np.ndarray]:
    """Return a maker of grey images (120, 160): what a place looks like, with noise by a seed."""
    return scene


@pytest.fixture(scope='session')
def described(image) -> Callable[..., Descriptor]:
    return lambda place, seed=0: describe(image(place, seed))


@pytest.fixture(scope='session')
def street():
    """Return the frames of two drives along a street, whose poses are known."""
    return drawn_street()


@pytest.fixture
def path(tmp_path):
    """Return where a map may be."""
    return tmp_path / 'map.db'


@pytest.fixture(scope='session')
def a_map() -> Callable[..., ReferenceMap]:
    """Return a maker of maps of sessions of so many places, `step_m` apart if poses are known."""
    cells = pack_cells(np.ones((4, 4, 8), np.float32))

    def make(*lengths: int, step_m: float | None = None, frame: str | None = None) -> ReferenceMap:
        made = ReferenceMap(EncodingConfig(image_size_px=64))
        for number, length in enumerate(lengths):
            made.sessions.append(MapSession(f'id {number}', '', number, frame=frame))
            for index in range(length):
                pose = None if step_m is None else Pose((index * step_m, 0.0, 0.0), AHEAD)
                stamp_ns = len(made) * SECOND_NS
                nothing = np.zeros(made.global_descriptors.shape[1])
                place = Place(stamp_ns, pose=pose, session=number)
                made.add(place, cells, descriptor=nothing)
        return made

    return make
