# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The preparation of images: frames are turned upright, and hidden parts are masked."""

from dataclasses import replace
import math
from typing import Any

from convseq_ros.config import Config, EncodingConfig, RobotConfig
from convseq_ros.core.encoding.descriptor import HOG
from convseq_ros.core.encoding.regions import REGION
from convseq_ros.core.rigid import matrix, of_roll_pitch_yaw, pose_of
from convseq_ros.core.types import Camera, Frame, Gray
from convseq_ros.errors import ConfigError
import cv2
import numpy as np

# Turning an image to the left moves its right side to the top.
_ON_ITS_SIDE = of_roll_pitch_yaw((0.0, 0.0, 0.0), math.pi / 2, 0.0, 0.0)
_WHITE = 128  # level from which on a pixel of a mask is white: the camera sees the world there


def upright(frame: Frame, encoding: EncodingConfig, robot: RobotConfig = RobotConfig()) -> Frame:
    """Return a frame turned as configured; the robot's mount is used if the camera has none."""
    turns = encoding.image_rotation_deg // 90
    camera = frame.camera
    for _ in range(turns if camera else 0):
        camera = _turned_left(camera) if camera else None
    if camera and not camera.mount and any(robot.mount):
        x, y, z, *turn = robot.mount
        camera = replace(camera, mount=of_roll_pitch_yaw((x, y, z), *turn))

    def turned(image: Any) -> Any:
        return image if image is None else np.ascontiguousarray(np.rot90(image, turns))

    names = ('gray', 'depth_m', 'color') if turns else ()
    images = {name: turned(getattr(frame, name)) for name in names}
    return replace(frame, camera=camera, **images)


def _turned_left(camera: Camera) -> Camera:
    return replace(
        camera,
        width_px=camera.height_px,
        height_px=camera.width_px,
        fx_px=camera.fy_px,
        fy_px=camera.fx_px,
        cx_px=camera.cy_px,
        cy_px=camera.width_px - 1 - camera.cx_px,
        distortion=_distortion_turned_left(camera),
        mount=camera.mount and pose_of(matrix(camera.mount) @ matrix(_ON_ITS_SIDE)),
    )


def _distortion_turned_left(camera: Camera) -> tuple[float, ...]:
    """Return the coefficients of a turned lens: the tangential ones are swapped."""
    if camera.distortion_model == 'equidistant' or len(camera.distortion) < 4:
        return camera.distortion
    k1, k2, p1, p2, *others = camera.distortion
    return k1, k2, -p2, p1, *others


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
    reach = np.ones((2 * HOG.margin_px + 1,) * 2, np.uint8)
    white = cv2.erode((square >= _WHITE).astype(np.uint8), reach)
    visible = white.reshape(side // HOG.cell_px, HOG.cell_px, -1, HOG.cell_px).all(axis=(1, 3))
    regions = cv2.erode(visible.astype(np.uint8), np.ones((REGION.span,) * 2), borderValue=0)
    if not regions.any():
        hides = f'{encoding.image_mask} hides everything; white is what the camera sees'
        raise ConfigError(f'image_mask: {hides}')
    stored = '' if visible.all() else f'#{np.packbits(visible).tobytes().hex()}'
    return replace(config, encoding=replace(encoding, image_mask=stored))


def without_path(encoding: EncodingConfig) -> EncodingConfig:
    """Return an encoding; ConfigError if its mask is still the path of a picture."""
    if encoding.image_mask.startswith('#') or not encoding.image_mask:
        return encoding
    raise ConfigError(
        f'image_mask: {encoding.image_mask} is a file; read it, and use `view.masked`'
    )
