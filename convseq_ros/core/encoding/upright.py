# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Frames turned upright, with their cameras."""

from dataclasses import replace
import math

from convseq_ros.config import EncodingConfig, RobotConfig
from convseq_ros.core.rigid import matrix, of_roll_pitch_yaw, pose_of
from convseq_ros.core.types import Camera, Frame
import numpy as np

# Turning an image to the left moves its right side to the top.
_ON_ITS_SIDE = of_roll_pitch_yaw((0.0, 0.0, 0.0), math.pi / 2, 0.0, 0.0)


def upright(frame: Frame, encoding: EncodingConfig, robot: RobotConfig = RobotConfig()) -> Frame:
    """Return a frame turned as configured; the robot's mount is used if the camera has none."""
    turns = encoding.image_rotation_deg // 90
    camera = frame.camera
    for _ in range(turns if camera else 0):
        camera = _turned_left(camera) if camera else None
    if camera and not camera.mount and any(robot.mount):
        x, y, z, *turn = robot.mount
        camera = replace(camera, mount=of_roll_pitch_yaw((x, y, z), *turn))

    gray = frame.gray
    if turns and gray is not None:
        gray = np.ascontiguousarray(np.rot90(gray, turns))
    return replace(frame, camera=camera, gray=gray)


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
