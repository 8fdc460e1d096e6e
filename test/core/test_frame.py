# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a frame takes, and what it refuses in one line."""

from convseq_ros.app.map_builder import build_map
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.types import Frame
import numpy as np
import pytest


@pytest.mark.parametrize('kind', [np.int64, np.int32, np.uint64])
def test_a_map_of_numpy_stamps_can_be_opened(tmp_path, image, kind):
    stamps_ns = np.arange(1, 4, dtype=kind) * kind(10**8)
    built = build_map(
        [Frame(stamp_ns, image(at)) for at, stamp_ns in enumerate(stamps_ns)], tmp_path / 'map.db'
    )
    opened = open_map(tmp_path / 'map.db')
    assert [place.stamp_ns for place in opened.places] == stamps_ns.tolist()
    assert len(built) == 3


@pytest.mark.parametrize('stamp_ns', [1.5, np.float64(10**9), '10', None, 2**63, -(2**63) - 1])
def test_a_stamp_that_is_no_integer_of_64_bits_is_refused(stamp_ns):
    with pytest.raises(ValueError, match=r'stamp_ns: .*; give ns'):
        Frame(stamp_ns, None)


@pytest.mark.parametrize(
    ('change', 'got'),
    [
        (np.ndarray.tolist, 'list'),
        (np.ndarray.tobytes, 'bytes'),
        (lambda gray: gray / 255, 'float64'),
        (lambda gray: gray.astype(np.int64), 'int64'),
        (lambda gray: gray > 9, 'bool'),
        (lambda gray: np.dstack([gray] * 3), r'4, 6, 3\) uint8'),
        (lambda gray: gray[:0], r'\(0, 6\) uint8'),
    ],
)
def test_an_image_that_is_not_gray_is_refused(change, got):
    with pytest.raises(ValueError, match=rf'expected \(H, W\) uint8, got .*{got}'):
        Frame(1, change(np.zeros((4, 6), np.uint8)))
