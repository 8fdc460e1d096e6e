# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
From the fields of an image message, or the bytes of a picture file, to a grey image.

Messages are duck-typed: those of rclpy and of rosbags, which hold their data as array, numpy
array or bytes, serve alike. Colour reaches grey by one road (BGR, then `gray_from_bgr`), so that
a folder, a recording and a camera that show the same picture give the same pixels.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from convseq_ros.errors import ImageError
from convseq_ros.picture_header import declared
from convseq_ros.reading_config import ReadingConfig
import cv2
import numpy as np
import numpy.typing as npt

Gray = npt.NDArray[np.uint8]
Pixels = npt.NDArray[np.uint8]

_READ_FLAGS = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
_MEGA = 1_000_000
_PIXEL_BYTES = 8  # a pixel of four numbers of 16 bits; larger ones belong to small pictures
_JPEG_START, _JPEG_SCAN, _JPEG_END = b'\xff\xd8', b'\xff\xda', b'\xff\xd9'


def gray_from_bgr(bgr: Pixels) -> Gray:
    """Return the grey image (H, W) of one in colour (H, W, 3): the only way from it."""
    return _uint8(cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY))


def gray_and_color(pixels: Pixels, reading: ReadingConfig) -> tuple[Gray, Pixels | None]:
    """Return the grey image of pixels (H, W) or (H, W, 3), and a copy of these if that is kept."""
    if pixels.ndim == 2:
        return pixels, None
    return gray_from_bgr(pixels), pixels.copy() if reading.keeps_color else None


def decode_image(message: Any, reading: ReadingConfig = ReadingConfig()) -> Gray:
    """Return the grey image (H, W) of a sensor_msgs/Image; errors of `image_pixels`."""
    return _only_gray(image_pixels(message, reading))


def decode_compressed(message: Any, reading: ReadingConfig = ReadingConfig()) -> Gray:
    """Return the grey image (H, W) of a CompressedImage; errors of `compressed_pixels`."""
    return _only_gray(compressed_pixels(message, reading))


def decode_picture(data: Any, reading: ReadingConfig = ReadingConfig()) -> Gray:
    """Return the grey image (H, W) of an encoded picture; errors of `picture_pixels`."""
    return _only_gray(picture_pixels(data, reading))


def _only_gray(pixels: Pixels) -> Gray:
    return pixels if pixels.ndim == 2 else gray_from_bgr(pixels)


def image_pixels(message: Any, reading: ReadingConfig = ReadingConfig()) -> Pixels:
    """
    Return the image of a sensor_msgs/Image: (H, W), or in colour (H, W, 3), blue, green, red.

    The message has `height`, `width`, `encoding`, `is_bigendian`, `step` and `data`; what is
    returned is C-contiguous, and in colour perhaps the message's own memory. ImageError if the
    encoding is unknown, the size is zero, too large for `reading` or does not suit the encoding,
    or `step` or `data` is too small for it.
    """
    encoding = ENCODINGS.get(message.encoding)
    if encoding is None:
        raise ImageError(
            f'encoding: {message.encoding!r} is not supported; use {", ".join(ENCODINGS)}'
        )
    height, width, step = int(message.height), int(message.width), int(message.step)
    if height < 1 or width < 1:
        raise ImageError(
            f'height, width: {height} x {width} px is an empty image; check the camera driver'
        )
    if height < encoding.min_side or width < encoding.min_side or width % encoding.width_multiple:
        raise ImageError(
            f'height, width: {height} x {width} px does not suit {message.encoding}; it needs '
            f'at least {encoding.min_side} px and a width divisible by {encoding.width_multiple}'
        )
    row = width * encoding.bytes_per_pixel
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
    shape = (height, width, encoding.bytes_per_pixel)
    strides = (step, encoding.bytes_per_pixel, 1)
    pixels = np.ascontiguousarray(np.ndarray(shape, np.uint8, data, 0, strides))
    return encoding.to_pixels(pixels, bool(message.is_bigendian))


def compressed_pixels(message: Any, reading: ReadingConfig = ReadingConfig()) -> Pixels:
    """
    Return the image of a sensor_msgs/CompressedImage: (H, W, 3) blue, green, red.

    The message has `data` and `format` ('jpeg', 'png', or as image_transport writes it, such as
    'bgr8; jpeg compressed bgr8'). ImageError if the format is compressedDepth, or as of
    `picture_pixels`.
    """
    if 'compressedDepth' in message.format:
        raise ImageError(
            f'format: {message.format!r} is a depth image; choose the topic of the colour camera'
        )
    try:
        return picture_pixels(message.data, reading)
    except ImageError as error:
        raise ImageError(f'format {message.format!r}: {error}') from None


def picture_pixels(data: Any, reading: ReadingConfig = ReadingConfig()) -> Pixels:
    """
    Return a picture file's content, (H, W, 3) blue, green, red, as stored: EXIF turns nothing.

    ImageError if the data are cut short, damaged, of an unknown kind, or declare more pixels than
    `reading` allows; they are not decoded then.
    """
    encoded = np.frombuffer(data, np.uint8)
    content = data if isinstance(data, bytes) else encoded.tobytes()
    asked = declared(content)
    if asked is None:
        raise ImageError(
            f'data: {encoded.size} bytes cannot be decoded; expected a whole JPEG or PNG'
        )
    reading.refuse_picture(asked, 'data')
    if _is_cut_jpeg(content):
        raise ImageError(f'data: {encoded.size} bytes of a JPEG that is cut short; send it whole')
    try:
        bgr = cv2.imdecode(encoded, _READ_FLAGS) if encoded.size else None
    except cv2.error:
        bgr = None
    if bgr is None:
        raise ImageError(
            f'data: {encoded.size} bytes cannot be decoded; expected a whole JPEG or PNG'
        )
    return _uint8(bgr)


def read_picture(path: Path, reading: ReadingConfig = ReadingConfig()) -> Pixels:
    """
    Return a picture file as `picture_pixels` does.

    ImageError also if the file is larger than the largest picture can be, OSError if it cannot be
    read.
    """
    size = path.stat().st_size
    reading.refuse_image(size // _PIXEL_BYTES, f'data: {size / _MEGA:.3g} MB')
    return picture_pixels(path.read_bytes(), reading)


def _is_cut_jpeg(data: bytes) -> bool:
    """Tell a JPEG without its end, which some OpenCV versions fill up with grey."""
    return data.startswith(_JPEG_START) and data.rfind(_JPEG_END) <= data.rfind(_JPEG_SCAN)


def _uint8(array: Any) -> npt.NDArray[np.uint8]:
    return np.asarray(array, np.uint8)


def _gray(pixels: Pixels, _: bool) -> Gray:
    return pixels[:, :, 0].copy()


def _high_byte(pixels: Pixels, is_bigendian: bool) -> Gray:
    return pixels[:, :, 0 if is_bigendian else 1].copy()


def _bgr(pixels: Pixels, _: bool) -> Pixels:
    return pixels


def _to_bgr(conversion: int) -> Callable[[Pixels, bool], Pixels]:
    def to_pixels(pixels: Pixels, _: bool) -> Pixels:
        return _uint8(cv2.cvtColor(pixels, conversion))

    return to_pixels


@dataclass(frozen=True, slots=True)
class _Encoding:
    bytes_per_pixel: int
    to_pixels: Callable[[Pixels, bool], Pixels]
    min_side: int = 1
    width_multiple: int = 1


# ROS names a mosaic by its first two rows from the left edge; so do OpenCV's four-letter names
# (the older two-letter ones, such as BayerBG, start one pixel further in).
ENCODINGS = {
    'mono8': _Encoding(1, _gray),
    'mono16': _Encoding(2, _high_byte),
    '8UC1': _Encoding(1, _gray),
    '8UC3': _Encoding(3, _bgr),
    'bgr8': _Encoding(3, _bgr),
    'rgb8': _Encoding(3, _to_bgr(cv2.COLOR_RGB2BGR)),
    'bgra8': _Encoding(4, _to_bgr(cv2.COLOR_BGRA2BGR)),
    'rgba8': _Encoding(4, _to_bgr(cv2.COLOR_RGBA2BGR)),
    'bayer_rggb8': _Encoding(1, _to_bgr(cv2.COLOR_BayerRGGB2BGR), min_side=3),
    'bayer_bggr8': _Encoding(1, _to_bgr(cv2.COLOR_BayerBGGR2BGR), min_side=3),
    'bayer_gbrg8': _Encoding(1, _to_bgr(cv2.COLOR_BayerGBRG2BGR), min_side=3),
    'bayer_grbg8': _Encoding(1, _to_bgr(cv2.COLOR_BayerGRBG2BGR), min_side=3),
    'yuv422': _Encoding(2, _to_bgr(cv2.COLOR_YUV2BGR_UYVY), width_multiple=2),
    'uyvy': _Encoding(2, _to_bgr(cv2.COLOR_YUV2BGR_UYVY), width_multiple=2),
    'yuv422_yuy2': _Encoding(2, _to_bgr(cv2.COLOR_YUV2BGR_YUY2), width_multiple=2),
    'yuyv': _Encoding(2, _to_bgr(cv2.COLOR_YUV2BGR_YUY2), width_multiple=2),
}
