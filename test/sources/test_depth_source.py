# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Depth images of folders and topics, and which of them belongs to a frame."""

from convseq_ros.errors import ImageError, SourceError
from convseq_ros.reading_config import ReadingConfig
from convseq_ros.sources import open_annotated
from convseq_ros.sources.depth import decode_depth
import cv2
import numpy as np
import pytest


def depth(recorder, number, stamp_ns, **changes):
    """Return a message of one depth, in millimetres."""
    data = np.full((24, 32), 1000 + number, '<u2')
    fields = {'encoding': '16UC1', 'step': 64, 'data': data.view(np.uint8).ravel(), **changes}
    return recorder.image(np.zeros((24, 32), np.uint8), stamp_ns, **fields)


def test_both_encodings_and_both_orders_of_bytes(recorder):
    metres = np.linspace(0.5, 8, 24 * 32).reshape(24, 32)
    metres[0, 0] = np.nan
    big = metres.astype('>f4')
    message = depth(
        recorder, 0, 5, encoding='32FC1', step=128, is_bigendian=1, data=big.view(np.uint8).ravel()
    )
    assert np.allclose(decode_depth(message), metres, equal_nan=True)
    assert decode_depth(depth(recorder, 7, 5))[0, 0] == pytest.approx(1.007)


@pytest.mark.parametrize(
    ('changes', 'word'),
    [
        ({'encoding': 'rgb8'}, 'encoding'),
        ({'height': 0}, 'height'),
        ({'step': 10}, 'step'),
        ({'height': 25}, 'too short'),
        ({'data': np.zeros(0, np.uint8)}, 'too short'),
    ],
)
def test_what_is_no_depth_image_is_refused_in_a_line(recorder, changes, word):
    with pytest.raises(ImageError, match=word):
        decode_depth(depth(recorder, 0, 5, **changes))


def test_a_depth_image_that_is_too_large_is_not_decoded(recorder):
    rows = np.zeros((200, 200), '<u2')
    message = depth(
        recorder, 0, 5, height=200, width=200, step=400, data=rows.view(np.uint8).ravel()
    )
    with pytest.raises(ImageError, match='max_image_mpx'):
        decode_depth(message, ReadingConfig(max_image_mpx=0.01))


def test_a_frame_gets_the_depth_of_its_moment(recorder, pictures):
    """Depth comes 3 ms later, is missing once, damaged once, and once far too late."""
    rows = recorder.drive(pictures)
    for number in range(len(pictures)):
        at_ns = recorder.start_ns + number * recorder.step_ns + (60_000_000 if number == 6 else 0)
        changes = {'encoding': 'rgb8'} if number == 4 else {}
        message = depth(recorder, number, at_ns + 3_000_000, **changes)
        if number != 2:
            rows.append(('/depth', at_ns + 8_000_000, message))
    rows.sort(key=lambda row: row[1])
    path = recorder.write('mcap file', rows)
    source = open_annotated(path, '/camera/image_raw', depth='/depth')
    for _ in range(2):
        told = [frame.depth_m for frame in source]
        known = [None if one is None else round(float(one[0, 0]) * 1000) - 1000 for one in told]
        assert known == [0, 1, None, 3, None, 5, None, 7, 8, 9, 10, 11]
    assert [line for line in source.warnings if 'rgb8' in line]
    with pytest.raises(SourceError, match='nowhere'):
        open_annotated(path, '/camera/image_raw', depth='/nowhere')


def test_a_folder_of_depth_goes_with_a_folder_of_pictures(tmp_path, pictures):
    images, depths = tmp_path / 'images', tmp_path / 'depth'
    images.mkdir()
    depths.mkdir()
    for number, gray in enumerate(pictures[:4]):
        cv2.imwrite(str(images / f'{number}.png'), gray)
    for number in range(3):
        cv2.imwrite(str(depths / f'{number}.png'), np.full((24, 32), 2000 + number, np.uint16))
    cv2.imwrite(str(depths / '1.png'), pictures[0])
    source = open_annotated(images, depth=str(depths))
    told = [frame.depth_m for frame in source]
    assert [None if one is None else round(float(one[0, 0]), 3) for one in told] == [
        2.0, None, 2.002, None,
    ]  # fmt: skip
    assert [line for line in source.warnings if '16 bits' in line]
    with pytest.raises(SourceError, match='nowhere'):
        open_annotated(images, depth=str(tmp_path / 'nowhere'))
