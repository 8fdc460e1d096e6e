# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Converts image messages, and the bytes of picture files, to grey images.

Messages are duck-typed: their data may be bytes, an array or a view. Colour is always converted in
the same way (BGR, then `gray_of`), so that the same picture in a folder, a recording and a
camera's message gives the same pixels.
"""

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
import re
from typing import Any

from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.errors import FormatError, ImageError
from convseq_ros.io.picture_header import declared_size, refuse_large
from convseq_ros.sources.raw_message import COMPRESSED_IMAGE, RawMessage, REPUBLISH
import cv2
import numpy as np
import numpy.typing as npt

Gray = npt.NDArray[np.uint8]
Pixels = npt.NDArray[np.uint8]

_READ_FLAGS = cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH
_BITS = (8, 10, 12, 14, 16)  # of a pixel, by a camera's converter
_MEGA = 1_000_000
_PIXEL_BYTES = 8  # largest pixel of a large picture: four numbers of 16 bits
_JPEG_START, _JPEG_SCAN, _JPEG_END = b'\xff\xd8', b'\xff\xda', b'\xff\xd9'
_BLOCK_PX, _MISSING = 8, 128  # side of a block, and the grey of one whose data are missing
_NO_PICTURES = frozenset({
    'av1', 'avif', 'h264', 'h265', 'hevc', 'jxl', 'mpeg4', 'theora', 'vp8', 'vp9'
})  # fmt: skip
_VIDEO_STARTS = b'\0\0\0\1', b'\0\0\1'  # ITU-T H.264, annex B


def gray_of(pixels: Pixels) -> Gray:
    """Return the grey image (H, W) of pixels (H, W), or (H, W, 3): blue, green, red."""
    return pixels if pixels.ndim == 2 else _uint8(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY))


def message_pixels(message: RawMessage, reading: ReadingConfig = ReadingConfig()) -> Pixels:
    """Return the pixels of a serialized image, by `compressed_pixels` or `image_pixels`."""
    decode = compressed_pixels if message.type_name == COMPRESSED_IMAGE else image_pixels
    return decode(message.image(), reading)


def image_pixels(message: Any, reading: ReadingConfig = ReadingConfig()) -> Pixels:
    """
    Return the image of a sensor_msgs/Image: (H, W), or in colour (H, W, 3), blue, green, red.

    It is C-contiguous; a colour image may share the memory of the message. ImageError if the
    encoding is unknown, or size, `step` or `data` do not suit it.
    """
    encoding = ENCODINGS.get(message.encoding)
    if encoding is None:
        raise FormatError(
            f'encoding: {message.encoding!r} is not supported; use {", ".join(ENCODINGS)}'
        )
    height, width = int(message.height), int(message.width)
    least, multiple = encoding.min_side, encoding.width_multiple
    if height > 0 < width and (height < least or width < least or width % multiple):
        raise ImageError(
            f'height, width: {height} x {width} px does not suit {message.encoding}; it needs '
            f'at least {least} px and a width divisible by {multiple}'
        )
    pixels = _pixels_of(message, encoding.bytes_per_pixel, reading)
    if encoding.to_bgr is not None:
        return _uint8(cv2.cvtColor(pixels, encoding.to_bgr))
    if encoding.bytes_per_pixel == 3:
        return pixels
    if encoding.bytes_per_pixel == 1:
        return pixels[:, :, 0].copy()
    return of_16_bits(pixels.view('>u2' if message.is_bigendian else '<u2')[:, :, 0])


def of_16_bits(values: npt.NDArray[np.uint16]) -> Pixels:
    """Return an image of 8 bits from one of which 8, 10, 12, 14 or all 16 bits are in use."""
    largest = int(values.max(initial=0))
    in_use = next(bits for bits in _BITS if not largest >> bits)
    return (values >> (in_use - 8)).astype(np.uint8)


def _pixels_of(message: Any, pixel_bytes: int, reading: ReadingConfig) -> Pixels:
    """Return the bytes (H, W, bytes of a pixel) of a sensor_msgs/Image; ImageError if too few."""
    height, width, step = int(message.height), int(message.width), int(message.step)
    if height < 1 or width < 1:
        raise ImageError(
            f'height, width: {height} x {width} px is an empty image; check the camera driver'
        )
    row = width * pixel_bytes
    if step < row:
        raise ImageError(
            f'step: {step} bytes is too small; a row of {width} px in {message.encoding} '
            f'takes {row}'
        )
    data = np.frombuffer(message.data, np.uint8)
    needed = step * (height - 1) + row
    if data.size < needed:
        raise ImageError(
            f'data: {data.size} bytes is too short; {height} rows of step {step} take {needed}'
        )
    reading.refuse_image(height * width, f'height, width: {height} x {width} px')
    strides = (step, pixel_bytes, 1)
    view = np.ndarray((height, width, pixel_bytes), np.uint8, data, 0, strides)
    return np.ascontiguousarray(view)


def compressed_pixels(message: Any, reading: ReadingConfig = ReadingConfig()) -> Pixels:
    """Return the image (H, W, 3), blue, green, red, of a CompressedImage; or ImageError."""
    if 'compressedDepth' in message.format:
        raise FormatError(
            f'format: {message.format!r} is a depth image; choose the topic of the colour camera'
        )
    is_video = bytes(message.data[:4]).startswith(_VIDEO_STARTS)
    if is_video or not _NO_PICTURES.isdisjoint(re.findall('[a-z0-9]+', message.format.lower())):
        raise FormatError(f'format: {message.format!r} {REPUBLISH}')
    try:
        return picture_pixels(message.data, reading)
    except ImageError as error:
        raise ImageError(f'format {message.format!r}: {error}') from None


def picture_pixels(data: Any, reading: ReadingConfig = ReadingConfig()) -> Pixels:
    """
    Return a decoded picture (H, W, 3), upright by its EXIF; ImageError if damaged or too large.

    A JPEG of one scan may lack its end marker, and part of its last block.
    """
    encoded = np.frombuffer(data, np.uint8)
    content = data if isinstance(data, bytes) else encoded.tobytes()
    size, pixels = declared_size(content), None
    if size is not None:
        refuse_large(size, reading, 'data')
        if _lacks_end(content):
            whole = content + _JPEG_END
            if size.passes > 1 or _lacks_data(whole):
                count = encoded.size
                raise ImageError(f'data: {count} bytes of a JPEG that is cut short; send it whole')
            encoded = np.frombuffer(whole, np.uint8)
        with suppress(cv2.error):
            pixels = cv2.imdecode(encoded, _READ_FLAGS)
    if pixels is None:
        raise ImageError(
            f'data: {encoded.size} bytes cannot be decoded; expected a whole picture of 8 or 16 '
            'bits, such as JPEG or PNG'
        )
    if pixels.dtype == np.uint16:
        return of_16_bits(pixels)
    if pixels.dtype != np.uint8:
        raise ImageError(f'data: a picture of {pixels.dtype} numbers; save it with 8 or 16 bits')
    return np.asarray(pixels, np.uint8)


def read_picture(path: Path, reading: ReadingConfig = ReadingConfig()) -> Pixels:
    """Return the pixels of a picture file, as `picture_pixels`; ImageError, or OSError."""
    size = path.stat().st_size
    reading.refuse_image(size // _PIXEL_BYTES, f'data: {size / _MEGA:.3g} MB')
    return picture_pixels(path.read_bytes(), reading)


def _lacks_end(data: bytes) -> bool:
    """Return whether a JPEG lacks its end marker, and perhaps more before it."""
    return data.startswith(_JPEG_START) and data.rfind(_JPEG_END) <= data.rfind(_JPEG_SCAN)


def _lacks_data(data: bytes) -> bool:
    """Return whether the last block of a JPEG of one scan is missing: decoders make it grey."""
    gray = None
    with suppress(cv2.error):
        encoded = np.frombuffer(data, np.uint8)
        gray = cv2.imdecode(encoded, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)
    if gray is None:
        return True
    row, column = ((side - 1) // _BLOCK_PX * _BLOCK_PX for side in gray.shape)
    return bool((gray[row:, column:] == _MISSING).all())


def _uint8(array: Any) -> npt.NDArray[np.uint8]:
    return np.asarray(array, np.uint8)


@dataclass(frozen=True, slots=True)
class _Encoding:
    bytes_per_pixel: int
    to_bgr: int | None = None  # conversion code of OpenCV; None for grey and for BGR
    min_side: int = 1
    width_multiple: int = 1


# ROS names a mosaic by its first two rows from the left edge; so do OpenCV's four-letter names
# (the older two-letter ones, such as BayerBG, start one pixel further in).
ENCODINGS = {
    'mono8': _Encoding(1),
    'mono16': _Encoding(2),
    '8UC1': _Encoding(1),
    '8UC3': _Encoding(3),
    'bgr8': _Encoding(3),
    'rgb8': _Encoding(3, cv2.COLOR_RGB2BGR),
    'bgra8': _Encoding(4, cv2.COLOR_BGRA2BGR),
    'rgba8': _Encoding(4, cv2.COLOR_RGBA2BGR),
    'bayer_rggb8': _Encoding(1, cv2.COLOR_BayerRGGB2BGR, min_side=3),
    'bayer_bggr8': _Encoding(1, cv2.COLOR_BayerBGGR2BGR, min_side=3),
    'bayer_gbrg8': _Encoding(1, cv2.COLOR_BayerGBRG2BGR, min_side=3),
    'bayer_grbg8': _Encoding(1, cv2.COLOR_BayerGRBG2BGR, min_side=3),
    'yuv422': _Encoding(2, cv2.COLOR_YUV2BGR_UYVY, width_multiple=2),
    'uyvy': _Encoding(2, cv2.COLOR_YUV2BGR_UYVY, width_multiple=2),
    'yuv422_yuy2': _Encoding(2, cv2.COLOR_YUV2BGR_YUY2, width_multiple=2),
    'yuyv': _Encoding(2, cv2.COLOR_YUV2BGR_YUY2, width_multiple=2),
}
