# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What an image declares is checked before it is decoded, whatever its format."""

from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.errors import ImageError
from convseq_ros.io.picture_header import declared_size
from convseq_ros.sources import open_source
from convseq_ros.sources.images import picture_pixels
import cv2
import numpy as np
import pytest

SMALL = ReadingConfig(max_image_mpx=0.01)
FORMATS = {
    'jpg': ('.jpg', []),
    'progressive': ('.jpg', [cv2.IMWRITE_JPEG_PROGRESSIVE, 1]),
    'png': ('.png', []),
    'bmp': ('.bmp', []),
    'tiff': ('.tiff', []),
    'ppm': ('.ppm', []),
    'webp': ('.webp', [cv2.IMWRITE_WEBP_QUALITY, 101]),
    'lossy webp': ('.webp', [cv2.IMWRITE_WEBP_QUALITY, 50]),
}


def picture(name, height=100, width=120):
    gray = np.random.default_rng(3).integers(0, 256, (height, width, 3), np.uint8)
    suffix, options = FORMATS[name]
    return cv2.imencode(suffix, gray, options)[1].tobytes()


def jpeg_of(height, width, scans=1):
    """Return a JPEG whose header says so, with as many times its first scan."""
    data = picture('jpg', 16, 16)
    frame = data.index(b'\xff\xc0')
    sides = height.to_bytes(2, 'big') + width.to_bytes(2, 'big')
    data = data[: frame + 5] + sides + data[frame + 9 :]
    scan = data.index(b'\xff\xda')
    return data[:scan] + data[scan:-2] * scans + data[-2:]


@pytest.fixture
def decoded(monkeypatch):
    """Return a list that grows with every call of a decoder."""
    calls, decode = [], cv2.imdecode
    monkeypatch.setattr(cv2, 'imdecode', lambda *all_: calls.append(1) or decode(*all_))
    return calls


@pytest.mark.parametrize('name', FORMATS)
def test_a_picture_whose_header_declares_too_many_pixels_is_not_decoded(name, decoded):
    data = picture(name)
    assert declared_size(data).pixels == 12_000
    assert picture_pixels(data, ReadingConfig(max_image_mpx=0.012)).shape[:2] == (100, 120)
    decoded.clear()
    with pytest.raises(ImageError, match=r'0\.012 Mpx is more than max_image_mpx, 0\.01;'):
        picture_pixels(data, SMALL)
    assert not decoded


def test_a_jpeg_with_scans_without_end_is_not_decoded(decoded):
    with pytest.raises(ImageError, match='500 scans of 16 Mpx'):
        picture_pixels(jpeg_of(4_000, 4_000, scans=500))
    assert not decoded


def test_a_tiff_tile_larger_than_its_picture_is_not_decoded(decoded):
    def entry(tag, value):
        return tag.to_bytes(2, 'little') + b'\4\0\1\0\0\0' + value.to_bytes(4, 'little')

    tags = {256: 16, 257: 16, 258: 8, 277: 3, 322: 30_000, 323: 30_000}
    entries = b''.join(entry(tag, value) for tag, value in tags.items())
    data = b'II*\0\x08\0\0\0' + len(tags).to_bytes(2, 'little') + entries + bytes(4)
    with pytest.raises(ImageError, match='900 Mpx'):
        picture_pixels(data)
    assert not decoded


@pytest.mark.parametrize('kind', [b'IDAT', b'IEND'])
@pytest.mark.parametrize('left', [8, 10, 12, 10**6])
@pytest.mark.parametrize('length', [2**31 - 1, 2**32 - 1, 100_000])
def test_a_chunk_of_a_png_that_is_longer_than_the_file_is_not_decoded(kind, length, left, decoded):
    data = picture('png')
    at = data.index(kind) - 4
    data = data[:at] + (length.to_bytes(4, 'big') + data[at + 4 :])[:left]
    with pytest.raises(ImageError, match='cannot be decoded'):
        picture_pixels(data)
    assert not decoded


def test_bytes_after_the_end_of_a_png_are_ignored():
    assert picture_pixels(picture('png') + b'\xff' * 100).size


NO_SIZES = [b'P6 x', b'P5 -8 8 255 ', b'P5 6_4 8 255 ', b'P5 ' + b'9' * 400 + b' 8 255 ']
NO_SIZES += [b'II+\0' + b'\xff' * 63]  # a BigTIFF whose tags lie beyond 2^63


@pytest.mark.parametrize('data', [b'', b'GIF89a', b'\xff\xd8\xff', b'BM', b'II*\0', *NO_SIZES])
def test_data_without_an_image_size_are_not_decoded(data, decoded):
    with pytest.raises(ImageError, match='cannot be decoded'):
        picture_pixels(data)
    assert not decoded


def test_a_picture_file_larger_than_any_picture_is_not_read(tmp_path):
    with (tmp_path / '1.png').open('wb') as file:
        file.write(picture('png'))
        file.truncate(2_000_000_000)
    (frame,) = open_source(tmp_path)
    assert frame.gray is None and '2e+03 MB is more than max_image_mpx' in frame.problem
