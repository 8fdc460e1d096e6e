# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Thumbnails of images of any shape."""

from convseq_ros.core.map.place import thumbnail
import cv2
import numpy as np
import pytest


@pytest.mark.parametrize(
    ('shape', 'small'),
    [
        ((480, 640), (96, 128)),
        ((640, 160), (512, 128)),
        ((1, 5000), (1, 128)),
        ((5000, 1), (512, 1)),
        ((60_000, 2), (512, 1)),
        ((1, 1), (128, 128)),
    ],
)
def test_a_thumbnail_is_as_wide_as_asked_and_never_high(shape, small):
    jpeg = np.frombuffer(thumbnail(np.full(shape, 90, np.uint8), 128), np.uint8)
    assert cv2.imdecode(jpeg, cv2.IMREAD_GRAYSCALE).shape == small
