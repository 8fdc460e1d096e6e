# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Draws the street as a camera sees it: ground first, then panels from far to near.

Every surface is a plane, which a homography maps to the image. It is drawn in pieces with textures
shrunk to about one texel per pixel, so that distant objects do not flicker.
"""

from collections.abc import Iterator
import math

from convseq_ros.simulation.ground import GROUND_HALF_M, GROUND_RESOLUTION
from convseq_ros.simulation.layout import STRETCH_M
from convseq_ros.simulation.light import Floats, Image, Light
from convseq_ros.simulation.panel import Panel
from convseq_ros.simulation.street import Street, Stretch
from convseq_ros.simulation.texture import cloud
import cv2
import numpy as np
import numpy.typing as npt

Lines = npt.NDArray[np.float64]  # (n,), of columns or rows
_NEAR_M, _FAR_M = 0.4, 180.0
_CAMERA_M = 1.5  # above the road
_COARSEST = 6


class View:
    """A camera in the street, 1.5 m above the road, without pitch or roll."""

    def __init__(
        self, street: Street, light: Light, width: int, height: int, field_of_view_deg: float
    ) -> None:
        self._street, self._light = street, light
        self._width, self._height = width, height
        self._focal = width / 2 / math.tan(math.radians(field_of_view_deg) / 2)
        self._stretches: dict[int, Stretch] = {}
        self._roads: dict[tuple[int, int, int, int], Image] = {}
        self._background = self._paint_background()
        rows = np.arange(height) + 0.5 - height / 2
        depth = np.where(rows > 0, self._focal * _CAMERA_M / np.maximum(rows, 1e-3), 0.0)
        clear = np.where(rows > 0, np.exp(-depth / light.visibility_m), 1.0)
        self._ground_clear = np.repeat(clear[:, None], width, axis=1).astype(np.float32)
        self._haze = np.full((height, width, 4), (*light.horizon, 255), np.uint8)

    def _paint_background(self) -> Image:
        rise = np.linspace(0.0, 1.0, self._height // 2)[:, None, None] ** 1.2
        sky = np.array(self._light.zenith) * (1 - rise) + np.array(self._light.horizon) * rise
        rng = np.random.default_rng(self._street.seed)
        clouds = cloud(rng, self._height // 2, self._width // 4 + 1, 10)
        clouds = cv2.resize(clouds, (self._width, self._height // 2))
        sky = sky + (0.03 * self._light.zenith[0] * clouds)[..., None]
        picture = np.full((self._height, self._width, 4), 255, np.uint8)
        picture[: self._height // 2, :, :3] = np.clip(sky, 0, 255)
        earth = np.array((86, 110, 104)) * self._light.ground
        picture[self._height // 2 :, :, :3] = np.clip(earth, 0, 255)
        return picture

    def draw(self, x: float, y: float, heading_rad: float) -> Image:
        """Return the view, BGR, from x along the street and y to the left of its middle."""
        self._x, self._y = x, y
        self._cos, self._sin = math.cos(heading_rad), math.sin(heading_rad)
        self._canvas = self._background.copy()
        self._clear = self._ground_clear.copy()
        first, last = (math.floor((x + reach) / STRETCH_M) for reach in (-_FAR_M, _FAR_M))
        self._stretches = {
            i: self._stretches.get(i) or self._street.stretch(i, self._light)
            for i in range(first, last + 1)
        }
        self._draw_ground()
        for key in ('buildings', 'things'):
            panels = [p for stretch in self._stretches.values() for p in getattr(stretch, key)]
            near = [(d, p) for p in panels if (d := self._distance(p)) < p.visible_m]
            for _, panel in sorted(near, key=lambda item: -item[0]):
                self._draw_panel(panel, one_sided=key == 'buildings')
        faded = cv2.blendLinear(self._canvas, self._haze, self._clear, 1.0 - self._clear)
        picture: Image = cv2.cvtColor(faded, cv2.COLOR_BGRA2BGR)
        return picture

    def _distance(self, panel: Panel) -> float:
        """Return the distance of a panel, by which panels are sorted for occlusion."""
        low, high = sorted((panel.start[0], panel.end[0]))
        along = max(low - self._x, self._x - high, 0.0)
        return along + 0.01 * abs(panel.start[1] + panel.end[1])

    def _seen(self, x: float, y: float) -> tuple[float, float]:
        """Return the coordinates of a point to the right and in depth."""
        dx, dy = x - self._x, y - self._y
        return dx * self._sin - dy * self._cos, dx * self._cos + dy * self._sin

    def _draw_panel(self, panel: Panel, one_sided: bool) -> None:
        right_a, deep_a = self._seen(*panel.start)
        right_b, deep_b = self._seen(*panel.end)
        if panel.facing:
            half = math.hypot(right_b - right_a, deep_b - deep_a) / 2
            middle, deep = (right_a + right_b) / 2, (deep_a + deep_b) / 2
            right_a, right_b, deep_a, deep_b = middle - half, middle + half, deep, deep
        if max(deep_a, deep_b) < _NEAR_M:
            return
        one, other = (right_a, deep_a), (right_b, deep_b)
        visible = [_clipped(one, other), _clipped(other, one)]
        columns = [self._focal * right / deep + self._width / 2 for right, deep in visible]
        low, high = max(0, math.floor(min(columns))), min(self._width, math.ceil(max(columns)))
        across, inward = right_b - right_a, deep_b - deep_a
        cross = right_a * inward - deep_a * across
        length = math.hypot(across, inward)
        if high <= low or abs(cross) < 1e-3 * length or (one_sided and cross > 0):
            return
        slope = (np.arange(low, high) + 0.5 - self._width / 2) / self._focal
        nearest, furthest = sorted(deep for _, deep in visible)
        steep = slope * inward - across
        depth = cross / np.where(steep * cross > 0, steep, cross / furthest)
        depth = depth.clip(nearest, furthest)
        texel = panel.resolution * depth / self._focal
        for left, right, level in _runs(texel * depth * (length / abs(cross)), texel):
            spread = depth[left:right]
            rows = [
                self._height / 2 - self._focal * (z - _CAMERA_M) / d
                for z in (panel.bottom, panel.top)
                for d in (float(spread.min()), float(spread.max()))
            ]
            upper = max(0, math.floor(min(rows)))
            lower = min(self._height, math.ceil(max(rows)))
            if lower <= upper:
                continue
            origin = right_a, panel.top - _CAMERA_M, deep_a
            self._warp(
                panel.texture.level(*level),
                origin,
                (across, 0.0, inward),
                (0.0, panel.bottom - panel.top, 0.0),
                (low + left, low + right, upper, lower),
                np.exp(-spread / self._light.visibility_m).astype(np.float32),
            )

    def _warp(
        self,
        texture: Image,
        origin: tuple[float, float, float],
        across: tuple[float, float, float],
        down: tuple[float, float, float],
        region: tuple[int, int, int, int],
        clear: Floats | None,
    ) -> None:
        """Paint a plane, given by a corner and two edges (right, up, deep), into a region."""
        left, right, upper, lower = region
        height, width = texture.shape[:2]
        plane = np.array((across, down, origin)).T
        plane[:, 0] /= width
        plane[:, 1] /= height
        plane[:, 2] += 0.5 * (plane[:, 0] + plane[:, 1])
        camera = np.array(
            (
                (self._focal, 0.0, self._width / 2 - left - 0.5),
                (0.0, -self._focal, self._height / 2 - upper - 0.5),
                (0.0, 0.0, 1.0),
            )
        )
        drawn = cv2.warpPerspective(texture, camera @ plane, (right - left, lower - upper))
        target = self._canvas[upper:lower, left:right]
        alpha = drawn[..., 3]
        if clear is not None:
            veil = self._clear[upper:lower, left:right]
            np.copyto(veil, clear, where=alpha > 127)
        behind = cv2.cvtColor(cv2.bitwise_not(alpha), cv2.COLOR_GRAY2BGRA)
        cv2.add(cv2.multiply(target, behind, scale=1 / 255), drawn, dst=target)

    def _draw_ground(self) -> None:
        start = math.ceil(self._height / 2 + self._focal * _CAMERA_M / _FAR_M)
        rows = np.arange(start, self._height)
        depth = self._focal * _CAMERA_M / (rows + 0.5 - self._height / 2)
        aside = GROUND_RESOLUTION * depth / self._focal
        ahead = aside * depth / _CAMERA_M
        along = ahead * abs(self._cos) + aside * abs(self._sin)
        across = aside * abs(self._cos) + ahead * abs(self._sin)
        used = {}
        for upper, lower, level in _runs(along, across):
            ends = [
                self._x + d * (self._cos + side * self._width / 2 / self._focal * self._sin)
                for d in (depth[upper], depth[lower - 1])
                for side in (-1, 1)
            ]
            stretches = self._stretches
            first = max(min(stretches), math.floor(min(ends) / STRETCH_M))
            last = min(max(stretches), math.floor(max(ends) / STRETCH_M))
            if first > last:
                continue
            key = (*level, first, last)
            road = used[key] = (
                self._roads[key]
                if key in self._roads
                else np.ascontiguousarray(
                    np.hstack([stretches[i].ground.level(*level) for i in range(first, last + 1)])
                )
            )
            right, deep = self._seen(first * STRETCH_M, GROUND_HALF_M)
            length, wide = (last + 1 - first) * STRETCH_M, 2 * GROUND_HALF_M
            self._warp(
                road,
                (right, -_CAMERA_M, deep),
                (length * self._sin, 0.0, length * self._cos),
                (wide * self._cos, 0.0, -wide * self._sin),
                (0, self._width, start + upper, start + lower),
                None,
            )
        self._roads = used


def _clipped(end: tuple[float, float], other: tuple[float, float]) -> tuple[float, float]:
    """Return an end of a line (right, deep), moved along the line to the near plane if nearer."""
    if end[1] >= _NEAR_M:
        return end
    share = (_NEAR_M - end[1]) / (other[1] - end[1])
    return end[0] + share * (other[0] - end[0]), _NEAR_M


def _runs(across: Lines, down: Lines) -> Iterator[tuple[int, int, tuple[int, int]]]:
    """Yield runs of lines with the same level, from the number of texels per pixel."""
    both = np.log2(np.maximum(np.stack((across, down)), 1e-6)).round().astype(int)
    both = both.clip(0, _COARSEST)
    steps = np.flatnonzero(np.any(both[:, 1:] != both[:, :-1], axis=0)) + 1
    for first, last in zip((0, *steps.tolist()), (*steps.tolist(), both.shape[1]), strict=True):
        yield first, last, (int(both[0, first]), int(both[1, first]))
