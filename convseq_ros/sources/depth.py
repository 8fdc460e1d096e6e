# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From a message to a depth image, and which of several belongs to a moment."""

from collections.abc import Iterable
from typing import Any

from convseq_ros.errors import ImageError
from convseq_ros.reading_config import ReadingConfig
import numpy as np
import numpy.typing as npt

Depth = npt.NDArray[np.float32]  # (H, W), metres; 0 or not finite where unknown

REACH_NS = 20_000_000  # by which stamps of an image and its depth may differ; a frame takes 33 ms
KEPT = 8  # depth images that wait for their image
_MM = np.float32(1e-3)
_KINDS = {'16UC1': 'u2', 'mono16': 'u2', '32FC1': 'f4'}


def nearest(stamped: Iterable[tuple[int, Any]], stamp_ns: int) -> Any | None:
    """Return what has the stamp that is nearest to a time; None if none is within reach."""
    found = min(stamped, key=lambda one: abs(one[0] - stamp_ns), default=None)
    return found[1] if found and abs(found[0] - stamp_ns) <= REACH_NS else None


def decode_depth(message: Any, reading: ReadingConfig = ReadingConfig()) -> Depth:
    """
    Return the depth image of a sensor_msgs/Image: 16UC1 in millimetres, or 32FC1 in metres.

    ImageError if it is of another encoding, empty, too large, or shorter than it says.
    """
    kind = _KINDS.get(message.encoding)
    if kind is None:
        raise ImageError(
            f'encoding: {message.encoding!r} is no depth image; expected {", ".join(_KINDS)}'
        )
    height, width, step = int(message.height), int(message.width), int(message.step)
    size = np.dtype(kind).itemsize
    if height < 1 or width < 1 or step < width * size:
        raise ImageError(f'height, width, step: {height} x {width} px, {step} bytes is no image')
    data = np.frombuffer(message.data, np.uint8)
    if data.size < (needed := step * (height - 1) + width * size):
        raise ImageError(f'data: {data.size} bytes is too short; {height} rows take {needed}')
    reading.refuse_image(height * width, f'height, width: {height} x {width} px')
    typed = np.dtype(('>' if message.is_bigendian else '<') + kind)
    rows = np.ndarray((height, width * size), np.uint8, data, 0, (step, 1))
    numbers = np.ascontiguousarray(rows).view(typed)
    return metres(numbers)


def metres(numbers: npt.NDArray[Any]) -> Depth:
    """Return depths of whole millimetres, or of metres, in metres."""
    return numbers.astype(np.float32) * (_MM if numbers.dtype.kind == 'u' else np.float32(1))
