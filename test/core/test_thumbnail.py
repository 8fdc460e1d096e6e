# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Thumbnails of images of any shape."""

from convseq_ros.core.map.place import shown, thumbnail
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


def declaring(jpeg, height, width):
    """Return a JPEG with other sides in its header."""
    frame = jpeg.index(b'\xff\xc0')
    return (
        jpeg[: frame + 5]
        + height.to_bytes(2, 'big')
        + width.to_bytes(2, 'big')
        + jpeg[frame + 9 :]
    )


def test_only_what_may_be_a_thumbnail_is_decoded(monkeypatch):
    jpeg = thumbnail(np.full((480, 640), 90, np.uint8), 640)
    assert shown(jpeg).shape == (480, 640)
    assert shown(thumbnail(np.full((5000, 2), 90, np.uint8), 640)).shape[0] == 2560
    assert shown(b'') is None and shown(b'no picture') is None
    monkeypatch.setattr(cv2, 'imdecode', lambda *_: pytest.fail('it was decoded'))
    assert shown(declaring(jpeg, 30_000, 30_000)) is None
