# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What the shift between two images says: pixels, and how far the camera was turned.

A shift leads from the query to the reference. A camera that is turned to the left, a positive yaw
(REP-103), sees things further right than the reference does, so its columns are negative.
"""

from dataclasses import replace
import math

from convseq_ros.core.types import Camera, Frame, Match, Shift


def shift_px(shift: Shift, height: int, width: int, cells_across: int) -> Shift:
    """Return a shift, in cells of a square, in pixels of the image that the square was made of."""
    return shift[0] * height / cells_across, shift[1] * width / cells_across


def relative_yaw(shift_px: Shift, camera: Camera) -> float:
    """
    Return by how many radians, in (-pi, pi), the query's camera is turned left.

    Half the shift is to one side of the optical axis in the query, half to the other in the
    reference. Lens distortion is left out. A camera that was moved sideways sees near things
    shifted as well, which no single shift can tell from a turn.
    """
    return -2.0 * math.atan(shift_px[1] / (2.0 * camera.fx_px))


def measured(match: Match, frame: Frame, cells_across: int) -> Match:
    """Return an answer with what its shift means in the frame's own pixels, and to its camera."""
    best = match.best
    if best is None or best.shift is None or frame.gray is None:
        return match
    height, width = frame.gray.shape
    moved_px = shift_px(best.shift, height, width, cells_across)
    yaw_rad = relative_yaw(moved_px, frame.camera) if frame.camera else None
    return replace(match, shift_px=moved_px, relative_yaw_rad=yaw_rad)
