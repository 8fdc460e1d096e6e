# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How a map stores images: thumbnails for people, and kept images, as JPEG."""

from convseq_ros.core.types import constants, Gray
from convseq_ros.io.picture_header import declared_size
import cv2
import numpy as np

_QUALITY = 70  # of a thumbnail's JPEG, in percent; 2 to 3 kB at 128 px
_TALLEST = 4  # largest height of a thumbnail, in multiples of `thumbnail_width_px`
_MOST_PIXELS = _TALLEST * 640**2  # of a thumbnail; 640 is the largest `thumbnail_width_px`


@constants
class KEPT_IMAGE:
    """Constants of stored images; quality chosen on road_1 and road_2 (docs/GEOMETRY.md)."""

    quality_percent: int = 85  # of a JPEG; 70 doubles the error of poses at a corner
    longest_px: int = 1280  # longer side of an image in use; a file may hold any size


def thumbnail(gray: Gray, width_px: int) -> bytes:
    """Return an image (H, W) as a JPEG of a width, at most 4 times as high; empty for width 0."""
    if not width_px:
        return b''
    height, width = gray.shape
    scale = min(width_px / width, _TALLEST * width_px / height)
    size = max(1, round(width * scale)), max(1, round(height * scale))
    return _jpeg(cv2.resize(gray, size, interpolation=cv2.INTER_AREA), _QUALITY)


def _jpeg(gray: Gray, quality_percent: int) -> bytes:
    return cv2.imencode('.jpg', gray, [cv2.IMWRITE_JPEG_QUALITY, quality_percent])[1].tobytes()


def decode_jpeg(jpeg: bytes, most_pixels: float = _MOST_PIXELS) -> Gray | None:
    """Return the image (H, W) of a JPEG; None if it is invalid or has too many pixels."""
    size = declared_size(jpeg)
    if size is None or size.pixels * size.passes > most_pixels:
        return None
    gray = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
    return None if gray is None else np.asarray(gray, np.uint8)


def reduced(gray: Gray, longest_px: int) -> Gray:
    """Return an image (H, W), reduced if its longer side exceeds a length."""
    scale = longest_px / max(gray.shape)
    if scale >= 1:
        return gray
    height, width = (max(1, round(side * scale)) for side in gray.shape)
    return np.asarray(cv2.resize(gray, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


def encode_image(gray: Gray, width_px: int) -> bytes | None:
    """Return an image (H, W) as a JPEG, its longer side reduced to a width; None for width 0."""
    return _jpeg(reduced(gray, width_px), KEPT_IMAGE.quality_percent) if width_px else None


def decode_image(jpeg: bytes | None, max_mpx: float) -> Gray | None:
    """Return a kept image (H, W), or None without one; ValueError if too large or no JPEG."""
    if jpeg is None:
        return None
    if (gray := decode_jpeg(jpeg, max_mpx * 1e6)) is not None:
        return reduced(gray, KEPT_IMAGE.longest_px)
    raise ValueError(f'no JPEG within max_image_mpx, {max_mpx:g}; build the map again')
