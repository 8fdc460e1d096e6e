# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Drawn places for tests of the whole pipeline."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest


@pytest.fixture(scope='session')
def image() -> Callable[..., np.ndarray]:
    """Return a maker of grey images (120, 160): what a place looks like, with noise by a seed."""

    def make(place: int, seed: int = 0) -> np.ndarray:
        coarse = np.random.default_rng(place).random((20, 20)).astype(np.float32)
        noise = np.random.default_rng([place, seed]).random((120, 160))
        return ((cv2.resize(coarse, (160, 120)) + noise / 2) * 150).astype(np.uint8)

    return make
