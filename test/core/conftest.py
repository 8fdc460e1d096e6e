# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Drawn places for tests of the whole pipeline."""

from collections.abc import Callable

from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.types import Descriptor
from measured_pose import drawn_street
import numpy as np
from pictures import scene
import pytest


@pytest.fixture(scope='session')
def image() -> Callable[..., np.ndarray]:
    """Return a maker of grey images (120, 160): what a place looks like, with noise by a seed."""
    return scene


@pytest.fixture(scope='session')
def described(image) -> Callable[..., Descriptor]:
    """Return a maker of descriptors of these images."""
    return lambda place, seed=0: describe(image(place, seed))


@pytest.fixture(scope='session')
def street():
    """Return the frames of two drives along a street, whose poses are known."""
    return drawn_street()


@pytest.fixture
def path(tmp_path):
    """Return where a map may be."""
    return tmp_path / 'map.db'
