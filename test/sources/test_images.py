# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Every encoding against a known picture, in grey and colour, and all that can be wrong."""

from array import array
from functools import partial
import struct
from types import SimpleNamespace
import zlib

from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.errors import FormatError, ImageError
from convseq_ros.io.picture_header import declared_size
from convseq_ros.sources import open_source
from convseq_ros.sources.images import (
    compressed_pixels,
    ENCODINGS,
    gray_of,
    image_pixels,
    picture_pixels,
)
import cv2
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

BLUE, GREEN, RED = 200, 90, 30
as_array, as_numpy = partial(array, 'B'), partial(np.frombuffer, dtype=np.uint8)
GRAY_OF_COLOUR = round(0.114 * BLUE + 0.587 * GREEN + 0.299 * RED)
MOSAICS = {'rggb': 'RGGB', 'bggr': 'BGGR', 'gbrg': 'GBRG', 'grbg': 'GRBG'}


def message(pixels, encoding, bigendian=0, padding=0, container=bytes):
    """Return an Image whose rows end in `padding` bytes of 255."""
    height, width = pixels.shape[:2]
    rows = np.ascontiguousarray(pixels).view(np.uint8).reshape(height, -1)
    rows = np.pad(rows, ((0, 0), (0, padding)), constant_values=255)
    return fields_of(height, width, encoding, container(rows.tobytes()), rows.shape[1], bigendian)


def fields_of(height, width, encoding, data, step, bigendian=0):
    return SimpleNamespace(
        height=height, width=width, encoding=encoding, data=data, step=step, is_bigendian=bigendian
    )


def noise(*shape, dtype=np.uint8):
    return np.random.default_rng(1).integers(0, np.iinfo(dtype).max, shape, dtype=dtype)


def mosaic(pattern, bgr):
    """Return what a sensor behind a mosaic of colour filters sees of a picture."""
    plane = {'B': 0, 'G': 1, 'R': 2}
    pixels = np.empty(bgr.shape[:2], np.uint8)
    for place, colour in enumerate(pattern):
        row, column = divmod(place, 2)
        pixels[row::2, column::2] = bgr[row::2, column::2, plane[colour]]
    return pixels


@pytest.mark.parametrize('padding', [0, 5])
@pytest.mark.parametrize('container', [bytes, as_array, as_numpy])
@pytest.mark.parametrize('encoding', ['mono8', '8UC1'])
def test_gray_encodings_keep_every_pixel(encoding, container, padding):
    gray = noise(7, 9)
    decoded = gray_of(image_pixels(message(gray, encoding, padding=padding, container=container)))
    np.testing.assert_array_equal(decoded, gray)


@pytest.mark.parametrize('padding', [0, 6])
@pytest.mark.parametrize(
    ('encoding', 'channels'),
    [('bgr8', 'BGR'), ('8UC3', 'BGR'), ('rgb8', 'RGB'), ('bgra8', 'BGRA'), ('rgba8', 'RGBA')],
)
def test_colour_encodings_agree_with_bgr(encoding, channels, padding):
    bgr = noise(7, 9, 3)
    planes = {'B': bgr[..., 0], 'G': bgr[..., 1], 'R': bgr[..., 2], 'A': noise(7, 9)}
    pixels = np.stack([planes[channel] for channel in channels], axis=2)
    decoded = gray_of(image_pixels(message(pixels, encoding, padding=padding)))
    np.testing.assert_array_equal(decoded, gray_of(bgr))


@pytest.mark.parametrize('padding', [0, 4])
@pytest.mark.parametrize(('bigendian', 'dtype'), [(0, '<u2'), (1, '>u2')])
@pytest.mark.parametrize('bits', [8, 10, 12, 14, 16])
def test_mono16_is_scaled_by_the_bits_in_use_in_either_byte_order(bits, bigendian, dtype, padding):
    values = np.linspace(0, 2**bits - 1, 30).astype(np.uint16).reshape(5, 6)
    decoded = gray_of(image_pixels(message(values.astype(dtype), 'mono16', bigendian, padding)))
    np.testing.assert_array_equal(decoded, values >> (bits - 8))


@pytest.mark.parametrize('kind', ['pgm', 'png', 'tiff'])
@pytest.mark.parametrize('bits', [10, 12, 16])
def test_a_picture_of_16_bits_is_scaled_as_a_message_is(kind, bits):
    values = np.linspace(0, 2**bits - 1, 30).astype(np.uint16).reshape(5, 6)
    if kind == 'pgm':
        data = b'P5 6 5 %d\n' % (2**bits - 1) + values.astype('>u2').tobytes()
    else:
        data = cv2.imencode(f'.{kind}', values)[1].tobytes()
    np.testing.assert_array_equal(picture_pixels(data)[:, :, 0], values >> (bits - 8))


def test_a_picture_of_real_numbers_is_refused():
    data = cv2.imencode('.tiff', np.ones((5, 6, 3), np.float32))[1]
    with pytest.raises(ImageError, match='a picture of float32 numbers; save it with 8 or 16'):
        picture_pixels(data)


@pytest.mark.parametrize('name', MOSAICS)
def test_bayer_mosaic_of_a_drawn_picture_resembles_only_its_own_pattern(name):
    bgr = np.zeros((40, 40, 3), np.uint8)
    bgr[:20], bgr[20:, :20], bgr[20:, 20:] = (230, 40, 20), (20, 60, 240), (30, 220, 90)
    pixels = mosaic(MOSAICS[name], bgr)
    wanted = gray_of(bgr).astype(int)
    shown = {one: gray_of(image_pixels(message(pixels, f'bayer_{one}8'))) for one in MOSAICS}
    errors = {one: np.abs(gray - wanted).mean() for one, gray in shown.items()}
    assert min(errors, key=errors.get) == name
    assert errors[name] < 5 < sorted(errors.values())[1]


@pytest.mark.parametrize(
    ('encoding', 'order'),
    [('yuv422', 'UYVY'), ('uyvy', 'UYVY'), ('yuv422_yuy2', 'YUYV'), ('yuyv', 'YUYV')],
)
def test_yuv422_of_a_known_colour_becomes_its_gray(encoding, order):
    luma = 16 + (65.5 * RED + 128.6 * GREEN + 25.0 * BLUE) / 255
    u = 128 + (-37.8 * RED - 74.2 * GREEN + 112.0 * BLUE) / 255
    v = 128 + (112.0 * RED - 93.8 * GREEN - 18.2 * BLUE) / 255
    parts = {'Y': round(luma), 'U': round(u), 'V': round(v)}
    pair = np.array([parts[part] for part in order], np.uint8).reshape(2, 2)
    decoded = gray_of(image_pixels(message(np.tile(pair, (6, 4, 1)), encoding, padding=2)))
    assert decoded.shape == (6, 8)
    assert np.abs(decoded.astype(int) - GRAY_OF_COLOUR).max() <= 3


@pytest.mark.parametrize('encoding', ENCODINGS)
def test_a_decoded_image_owns_its_memory(encoding):
    size = ENCODINGS[encoding].bytes_per_pixel
    data = bytearray(noise(6, 8 * size).tobytes())
    decoded = gray_of(image_pixels(fields_of(6, 8, encoding, data, 8 * size)))
    before = decoded.copy()
    data[:] = bytes(len(data))
    np.testing.assert_array_equal(decoded, before)
    assert (decoded.dtype, decoded.shape) == (np.uint8, (6, 8))
    assert decoded.flags.c_contiguous and decoded.flags.owndata


@pytest.mark.parametrize(
    ('changes', 'words'),
    [
        ({'encoding': 'rgb9'}, ["'rgb9'", 'mono8', 'bayer_rggb8', 'yuv422_yuy2']),
        ({'encoding': ''}, ['encoding', "''"]),
        ({'height': 0}, ['height', '0 x 8']),
        ({'width': 0}, ['width', '6 x 0']),
        ({'height': 0, 'width': 0, 'step': 0, 'data': b''}, ['empty']),
        ({'step': 7}, ['step: 7', '8']),
        ({'step': 0}, ['step: 0']),
        ({'data': b'12345'}, ['data: 5 bytes', '48']),
        ({'data': b''}, ['data: 0 bytes']),
        ({'height': 2**32 - 1}, ['data: 48 bytes']),
        ({'width': 2**32 - 1}, ['step: 8']),
        ({'encoding': 'yuv422', 'width': 3}, ['6 x 3', 'divisible by 2']),
        ({'encoding': 'bayer_rggb8', 'height': 2}, ['2 x 8', 'at least 3']),
    ],
)
def test_wrong_fields_are_named_with_value_and_remedy_in_one_line(changes, words):
    fields = message(noise(6, 8), 'mono8')
    fields.__dict__.update(changes)
    with pytest.raises(ImageError) as caught:
        gray_of(image_pixels(fields))
    assert all(word in str(caught.value) for word in words)
    assert '\n' not in str(caught.value)


@settings(max_examples=150, deadline=None)
@given(
    height=st.integers(0, 5),
    width=st.integers(0, 5),
    step=st.integers(0, 30),
    data=st.binary(max_size=120),
    encoding=st.sampled_from([*ENCODINGS, 'bogus']),
    bigendian=st.integers(0, 1),
)
def test_any_fields_give_that_size_or_an_error(height, width, step, data, encoding, bigendian):
    fields = fields_of(height, width, encoding, data, step, bigendian)
    try:
        assert gray_of(image_pixels(fields)).shape == (height, width)
    except ImageError as error:
        assert '\n' not in str(error)


def smooth(*shape):
    return cv2.GaussianBlur(noise(*shape), (0, 0), 2)


@pytest.mark.parametrize(
    'name',
    ['png', 'bgr8; png compressed bgr8', 'rgb8; png compressed bgr8', 'mono8; png compressed '],
)
def test_png_is_exact_in_either_spelling_of_the_format(name):
    bgr = noise(8, 9, 3)
    fields = SimpleNamespace(format=name, data=cv2.imencode('.png', bgr)[1].tobytes())
    np.testing.assert_array_equal(gray_of(compressed_pixels(fields)), gray_of(bgr))


@pytest.mark.parametrize('name', ['jpeg', 'jpg', 'bgr8; jpeg compressed bgr8'])
@pytest.mark.parametrize('container', [bytes, as_array])
def test_jpeg_is_close_in_either_spelling_of_the_format(name, container):
    bgr = smooth(40, 50, 3)
    data = cv2.imencode('.jpg', bgr, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
    decoded = gray_of(compressed_pixels(SimpleNamespace(format=name, data=container(data))))
    assert np.abs(decoded.astype(int) - gray_of(bgr)).mean() < 2
    assert decoded.flags.c_contiguous and decoded.flags.owndata


def with_exif(jpeg, orientation):
    entry = struct.pack('<HHHIHHI', 1, 0x112, 3, 1, orientation, 0, 0)
    block = b'Exif\x00\x00II*\x00\x08\x00\x00\x00' + entry
    return jpeg[:2] + b'\xff\xe1' + struct.pack('>H', len(block) + 2) + block + jpeg[2:]


def test_a_picture_is_turned_by_its_exif_as_viewers_do():
    data = cv2.imencode('.jpg', smooth(20, 30))[1].tobytes()
    flat = gray_of(picture_pixels(data))
    turned = gray_of(picture_pixels(with_exif(data, orientation=6)))
    np.testing.assert_array_equal(turned, np.rot90(flat, -1))


@pytest.mark.skipif(
    not hasattr(cv2, 'IMWRITE_JPEG_SAMPLING_FACTOR'), reason='this OpenCV writes one subsampling'
)
@pytest.mark.parametrize('orientation', [1, 6])
@pytest.mark.parametrize('subsampled', [0x111111, 0x221111])
def test_a_jpeg_that_lacks_only_its_end_marker_is_decoded(orientation, subsampled):
    options = [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, subsampled]
    picture = cv2.imencode('.jpg', smooth(39, 50, 3), options)[1].tobytes()
    data = with_exif(picture, orientation)
    np.testing.assert_array_equal(picture_pixels(data[:-2]), picture_pixels(data))


def test_a_jpeg_that_lacks_its_last_block_or_scan_is_cut():
    dark = np.full((24, 32), 20, np.uint8)  # a block is a byte or two
    for progressive, lost in ((0, 5), (1, 2)):
        data = cv2.imencode('.jpg', dark, [cv2.IMWRITE_JPEG_PROGRESSIVE, progressive])[1].tobytes()
        with pytest.raises(ImageError, match='a JPEG that is cut short'):
            picture_pixels(data[:-lost])


@pytest.mark.parametrize(
    ('name', 'data'),
    [('h264', b'123'), ('bgr8; AVIF compressed', b'123'), ('jpeg', b'\0\0\0\1\x67'),
     ('', b'\0\0\1\x67')],
)  # fmt: skip
def test_video_is_refused_by_name_or_content_with_the_remedy(name, data):
    with pytest.raises(FormatError, match=f'^format: {name!r} is video.*image_transport repub'):
        compressed_pixels(SimpleNamespace(format=name, data=data))


@pytest.mark.parametrize('suffix', ['.jpg', '.png'])
@pytest.mark.parametrize('share', [0.0, 0.02, 0.3, 0.7, 0.9])  # of 12 blocks of a JPEG
def test_cut_pictures_are_image_errors(suffix, share, capfd):
    data = cv2.imencode(suffix, noise(40, 50, 3))[1].tobytes()
    fields = SimpleNamespace(format='jpeg', data=data[: int(len(data) * share)])
    with pytest.raises(ImageError, match=r"^format 'jpeg': data: \d+ bytes") as caught:
        gray_of(compressed_pixels(fields))
    assert '\n' not in str(caught.value)
    capfd.readouterr()


@pytest.mark.parametrize('data', [b'', b'hello world', bytes(100), zlib.compress(b'x' * 99)])
def test_an_invalid_picture_or_compressed_depth_is_an_image_error(data):
    with pytest.raises(ImageError, match='cannot be decoded'):
        gray_of(picture_pixels(data))
    depth = SimpleNamespace(format='16UC1; compressedDepth png', data=data)
    with pytest.raises(ImageError, match='compressedDepth'):
        gray_of(compressed_pixels(depth))


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
