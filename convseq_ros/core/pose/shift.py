# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The shift from a query to its place in pixels, and the turn that it shows.

A shift leads from the query to the reference. A camera that is turned to the left, a positive yaw
(REP-103), sees things further right than the reference does, so the columns of its shift are
negative.
"""

from dataclasses import replace
import math

from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.rigid import base_between
from convseq_ros.core.types import Camera, Frame, Match, Shift


def shift_px(shift: Shift, height: int, width: int, cells_across: int) -> Shift:
    """Return a shift in pixels of an image, given in cells of the square made from the image."""
    return shift[0] * height / cells_across, shift[1] * width / cells_across


def relative_yaw(shift_px: Shift, camera: Camera) -> float:
    """
    Return by how many radians, in (-pi, pi), the query's camera is turned left.

    Half the shift lies on either side of the optical axis. Approximate: lens distortion is
    ignored, and a camera that moved sideways sees near things shift as well.
    """
    return -2.0 * math.atan(shift_px[1] / (2.0 * camera.fx_px))


def with_shift_and_yaw(match: Match, frame: Frame, reference_map: ReferenceMap) -> Match:
    """Return a match with its shift in pixels of the frame, and with the relative yaw."""
    best = match.best
    if best is None or best.shift is None or frame.gray is None:
        return match
    height, width = frame.gray.shape
    moved_px, yaw_rad = shift_px(best.shift, height, width, reference_map.cell_shape[1]), None
    if (camera := frame.camera) and camera.fx_px:
        turn = base_between(reference_map.camera_of(best.reference_index, camera), camera)
        yaw_rad = relative_yaw(moved_px, camera) + math.atan2(turn[1, 0], turn[0, 0])
        yaw_rad = math.remainder(yaw_rad, math.tau)
    return replace(match, shift_px=moved_px, relative_yaw_rad=yaw_rad)
