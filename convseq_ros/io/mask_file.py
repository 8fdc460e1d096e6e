# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The picture file that says which part of images is hidden."""

from contextlib import suppress
from pathlib import Path

from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.errors import ConfigError, ImageError, SourceError
from convseq_ros.io.picture_header import declared_size, refuse_large
from convseq_ros.io.regular_file import read_bytes
import cv2
import numpy as np
import numpy.typing as npt


def read_mask(path: Path, reading: ReadingConfig) -> npt.NDArray[np.uint8]:
    """Return a mask as a grey image (H, W); ConfigError if it is no picture, or too large."""
    try:
        data = read_bytes(path, 'a picture', reading.refuse_file)
        size, picture = declared_size(data), None
        if size:
            refuse_large(size, reading, str(path))
    except (ImageError, SourceError) as error:
        raise ConfigError(f'image_mask: {error}') from None
    if size:
        with suppress(cv2.error):
            picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    if picture is None:
        raise ConfigError(f'image_mask: {path} is no picture that can be read; make it a PNG')
    return np.asarray(picture, np.uint8)
