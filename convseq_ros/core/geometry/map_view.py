# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Images upright, and those of another lens than the map's as the map's would have taken them.

A lens of another field of view shows a place as the map's lens shows one further on, or back. So
images of a wider lens are cut, and those of a narrower one stand in the middle, the rest masked.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

from convseq_ros.config import EncodingConfig, RobotConfig
from convseq_ros.core.encoding.descriptor import (
    cell_shape,
    HOG,
    mask_of,
    visible_cells,
    whole_cells,
)
from convseq_ros.core.geometry.lens import is_usable, pixels, rays_through
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.rigid import matrix, of_roll_pitch_yaw, pose_of
from convseq_ros.core.types import Camera, constants, Flags, Floats, Frame
import cv2
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


@constants
class VIEW:
    """Engineering, but for `least`."""

    alike: float = 1.1  # ratio of fields of view up to which images are taken as they are
    least: float = 0.1  # smallest share of the map's cells that an image must fill
    longest_px: int = 640  # longer side of an image in the map's view
    error: float = 0.01  # largest error of a ray


@dataclass(frozen=True, eq=False, slots=True)
class View:
    """How images of a camera become those of the map's lens."""

    camera: Camera  # the map's lens, on the robot's mount
    given: Camera  # the robot's, of the size to which images are reduced
    at: Floats  # (H, W, 2), the pixel of an image for each of the result: across, down
    encoding: EncodingConfig  # with a mask of what is not seen


class MapView:
    """
    Brings frames to the view of the lens that made a map, if both cameras are known.

    `encoding` is how the newest frame is described; None if it shows too little of the map's view.
    `barred` are the places of sessions that another lens took: a frame in one view shows them
    nearer or further on. `problem` is one line if the lenses differ, else empty. Where the map
    grows, frames stay as they are.
    """

    def __init__(self, reference_map: ReferenceMap, encoding: EncodingConfig, grows: bool) -> None:
        cameras = [session.camera for session in reference_map.sessions if session.camera]
        self._fields = {camera: field_of_view(camera) for camera in cameras}
        self._map = reference_map
        self._own, self._grows, self._side = encoding, grows, cell_shape(encoding.image_size_px)[0]
        self._seen: Camera | None = None
        self._view: View | None = None
        self.encoding: EncodingConfig | None = encoding
        self.barred: Sequence[range] = ()
        self.problem = ''

    def brought(self, frame: Frame) -> Frame:
        """Return an upright frame in the view of the map, with the camera that it has there."""
        if frame.camera is None or frame.gray is None:
            return frame
        if frame.camera != self._seen:
            self._seen = frame.camera
            self._compare(frame.camera)
        if (view := self._view) is None:
            return frame
        size = view.given.width_px, view.given.height_px
        gray = cv2.resize(frame.gray, size, interpolation=cv2.INTER_AREA)
        # Repeated edges have the brightness of the image, and no corners.
        shown = cv2.remap(gray, view.at, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return replace(frame, gray=shown, camera=view.camera)

    def _compare(self, camera: Camera) -> None:
        """Find out how a camera sees the view of the most similar lens of the map."""
        self._view, self.encoding, self.barred, self.problem = None, self._own, (), ''
        own = field_of_view(camera)
        known = [lens for lens, field in self._fields.items() if field > 0 and own > 0]
        if not known:
            return
        lens = min(known, key=lambda lens: _ratio(self._fields[lens], own))
        field = self._fields[lens]
        differ = f'the camera sees {math.degrees(own):.0f} degrees across, that of the map '
        differ += f'{math.degrees(field):.0f}'
        is_like = _ratio(field, own) <= VIEW.alike
        self.barred = self._of_other_lenses(own if self._grows else field)
        if self._grows and not is_like:
            self.problem = f'{differ}: its places are not matched; begin another map'
        elif not is_like:
            self.problem = f'{differ}: {self._show(camera, lens)}'
        if self.barred and not self.problem:
            count = sum(map(len, self.barred))
            self.problem = (
                f'{count} places of the map were seen by a lens that differs from the camera by '
                'more than 10 %, and are not matched: map these ways with this camera'
            )

    def _show(self, camera: Camera, lens: Camera) -> str:
        """Bring images of a camera to the view of a lens from now on; return one line on it."""
        view, visible = _made(camera, lens, self._own, self._side)
        share = visible.mean() / visible_cells(self._own.image_mask, self._side).mean()
        if share < VIEW.least:
            self.encoding = None
            return 'too little of its view to recognise a place; map with it'
        self._view, self.encoding = view, view.encoding
        return f'images are brought to its view, and fill {share:.0%} of it'

    def _of_other_lenses(self, field: float) -> list[range]:
        """Return the places of sessions whose lens has another field of view, in radians."""
        barred = []
        for span in self._map.session_ranges:
            camera = self._map.sessions[self._map.places[span.start].session].camera
            other = self._fields.get(camera, math.nan) if camera else math.nan
            if other > 0 and _ratio(other, field) > VIEW.alike:
                barred.append(span)
        return barred


def _ratio(field: float, other: float) -> float:
    """Return the ratio of two fields of view, at least 1."""
    return max(field / other, other / field)


def field_of_view(camera: Camera) -> float:
    """Return the horizontal field of view, radians; NaN if it is unknown or beyond 160 degrees."""
    if not is_usable(camera):
        return math.nan
    left, right = rays_through(camera, np.array([(0.0, 0.5), (1.0, 0.5)]))[:, 0].tolist()
    return math.atan(right) - math.atan(left)


def _made(camera: Camera, lens: Camera, encoding: EncodingConfig, side: int) -> tuple[View, Flags]:
    """Return the view of a map's lens for a camera's images, and its visible cells (S, S)."""
    # Pixels keep their size, so that nothing is lost, unless there are too many of them.
    finer = camera.fx_px / lens.fx_px
    fewer = min(1.0, VIEW.longest_px / (finer * max(lens.width_px, lens.height_px)))
    given = _scaled(camera, fewer)
    there = replace(_scaled(lens, finer * fewer), mount=camera.mount)
    size = there.width_px, there.height_px
    grid = np.indices(size[::-1]).reshape(2, -1).T[:, ::-1]
    rays = rays_through(there, (grid + 0.5) / size)
    at = pixels(given, rays)
    shares = (at + 0.5) / (given.width_px, given.height_px)
    # Beyond the field of a lens its distortion may fold back.
    off = abs(rays_through(given, shares) - rays) / VIEW.error
    seen: Flags = np.all(np.maximum(off, abs(2 * shares - 1)) <= 1, axis=1).reshape(size[::-1])
    square = cv2.resize(
        seen.astype(np.uint8), (side * HOG.cell_px,) * 2, interpolation=cv2.INTER_NEAREST
    )
    visible = whole_cells(square > 0) & visible_cells(encoding.image_mask, side)
    places = np.nan_to_num(at, nan=-1.0).reshape(*size[::-1], 2).astype(np.float32)
    return View(there, given, places, replace(encoding, image_mask=mask_of(visible))), visible


def _scaled(camera: Camera, scale: float) -> Camera:
    """Return a camera for images that are enlarged."""
    width, height = (max(1, round(scale * side)) for side in (camera.width_px, camera.height_px))
    across, down = width / camera.width_px, height / camera.height_px
    return replace(
        camera,
        width_px=width,
        height_px=height,
        fx_px=across * camera.fx_px,
        fy_px=down * camera.fy_px,
        # The middle of the first pixel is at 0.
        cx_px=across * (camera.cx_px + 0.5) - 0.5,
        cy_px=down * (camera.cy_px + 0.5) - 0.5,
    )
