# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What the shift between two images says: pixels, and how far the camera was turned.

A shift leads from the query to the reference. A camera that is turned to the left, which is
counter-clockwise seen from above and a positive yaw (REP-103), sees things further right than the
reference does; so the way from query to reference is to the left, and columns are negative.
"""

from dataclasses import replace
import math

from convseq_ros.core.types import Camera, Descriptor, Frame, Match, Shift


def shift_px(shift: Shift, height: int, width: int, cells_across: int) -> Shift:
    """
    Return a shift in pixels of the query image.

    Parameters
    ----------
    shift : (float, float)
        Rows and columns, in cells, from query to reference.
    height, width : int
        Of the query image, before it was resized to a square.
    cells_across : int
        Cells in a row, and in a column, of that square.

    Returns
    -------
    (float, float)
        Rows and columns, pixels.

    """
    rows, columns = shift
    return rows * height / cells_across, columns * width / cells_across


def relative_yaw(shift_px: Shift, camera: Camera) -> float:
    """
    Return by how much the query's camera is turned against the reference's.

    Parameters
    ----------
    shift_px : (float, float)
        From `shift_px`; pixels of the images that `camera` takes.
    camera : Camera
        Its focal length is used.

    Returns
    -------
    float
        Radians, positive to the left, in (-pi, pi).

    Notes
    -----
    What both images show lies evenly about the middle between both views: half the shift to one
    side of the optical axis in the query, half to the other in the reference. Lens distortion is
    left out. A camera that was moved sideways sees near things shifted as well, which no single
    shift can tell from a turn.

    """
    return -2.0 * math.atan(shift_px[1] / (2.0 * camera.fx_px))


def measured(match: Match, frame: Frame, descriptor: Descriptor) -> Match:
    """Return an answer with what its shift means in the frame's own pixels, and to its camera."""
    best = match.best
    if best is None or best.shift is None or frame.gray is None:
        return match
    height, width = frame.gray.shape
    moved_px = shift_px(best.shift, height, width, descriptor.cells.shape[1])
    yaw_rad = relative_yaw(moved_px, frame.camera) if frame.camera else None
    return replace(match, shift_px=moved_px, relative_yaw_rad=yaw_rad)
