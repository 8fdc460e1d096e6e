# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The picture file that says which part of images is hidden."""

from contextlib import suppress
from pathlib import Path

from convseq_ros.config import Config
from convseq_ros.errors import ConfigError, ImageError, SourceError
from convseq_ros.io.picture_header import declared_size, refuse_large
from convseq_ros.io.regular_file import read_bytes
import cv2
import numpy as np
import numpy.typing as npt


def read_mask(config: Config) -> npt.NDArray[np.uint8] | None:
    """
    Return the grey image (H, W) that `image_mask` names; None if it names none, or it was read.

    ConfigError if it is no picture, or larger than what may be read.
    """
    path, reading = config.encoding.image_mask, config.reading
    if not path or path.startswith('#'):
        return None
    try:
        data = read_bytes(Path(path), 'a picture', reading.refuse_file)
        size, picture = declared_size(data), None
        if size:
            refuse_large(size, reading, path)
    except (ImageError, SourceError) as error:
        raise ConfigError(f'image_mask: {error}') from None
    if size:
        with suppress(cv2.error):
            picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    if picture is None:
        raise ConfigError(f'image_mask: {path} is no picture that can be read; make it a PNG')
    return np.asarray(picture, np.uint8)
