# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The mask: which cells of an image show the robot, or nothing of the world."""

from dataclasses import replace

from convseq_ros.config import Config, EncodingConfig
from convseq_ros.core.encoding.descriptor import mask_of, whole_cells
from convseq_ros.core.encoding.regions import REGION
from convseq_ros.core.types import Gray
from convseq_ros.errors import ConfigError
import cv2
import numpy as np

_WHITE = 128  # level from which on a pixel of a mask is white: the camera sees the world there


def masked(config: Config, picture: Gray | None) -> Config:
    """
    Return a configuration whose mask is a bit per cell, as maps store it, instead of a path.

    `picture`, (H, W), is what `io.mask_file.read_mask` reads; None changes nothing. A cell is
    visible if all of it, and 2 px around it, are white in the upright square image that the
    picture is scaled to. A mask that hides nothing becomes empty. ConfigError if it hides
    everything.
    """
    if picture is None:
        return config
    encoding = config.encoding
    turned = np.rot90(picture, encoding.image_rotation_deg // 90)
    side = encoding.image_size_px
    square = cv2.resize(np.ascontiguousarray(turned), (side, side), interpolation=cv2.INTER_AREA)
    visible = whole_cells(square >= _WHITE)
    regions = cv2.erode(visible.astype(np.uint8), np.ones((REGION.span,) * 2), borderValue=0)
    if not regions.any():
        hides = f'{encoding.image_mask} hides everything; white is what the camera sees'
        raise ConfigError(f'image_mask: {hides}')
    return replace(config, encoding=replace(encoding, image_mask=mask_of(visible)))


def without_path(encoding: EncodingConfig) -> EncodingConfig:
    """Return an encoding; ConfigError if its mask is still the path of a picture."""
    if encoding.image_mask.startswith('#') or not encoding.image_mask:
        return encoding
    raise ConfigError(
        f'image_mask: {encoding.image_mask} is a file; use `masked(config, read_mask(config))` of '
        'core.encoding.mask and io.mask_file'
    )
