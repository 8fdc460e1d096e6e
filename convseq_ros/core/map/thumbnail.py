# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Small pictures of references, for people to look at."""

import cv2
import numpy as np
import numpy.typing as npt

_QUALITY = 70


def thumbnail(gray: npt.NDArray[np.uint8], width_px: int) -> bytes:
    """Return a JPEG of an image (H, W), reduced to a width; empty if the width is 0."""
    if not width_px:
        return b''
    height_px = max(1, round(gray.shape[0] * width_px / gray.shape[1]))
    small = cv2.resize(gray, (width_px, height_px), interpolation=cv2.INTER_AREA)
    return cv2.imencode('.jpg', small, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1].tobytes()


def picture(jpeg: bytes) -> npt.NDArray[np.uint8] | None:
    """Return the image in a thumbnail, uint8 of shape (H, W), or None if there is none."""
    if not jpeg:
        return None
    return cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
