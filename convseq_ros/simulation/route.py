# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A route through a town whose streets cross at right angles."""

from bisect import bisect_right
from dataclasses import dataclass, field
from itertools import accumulate, pairwise
import math

from convseq_ros.errors import ConvseqError
from convseq_ros.simulation.street import Spot, Street
import numpy as np

Corner = tuple[float, float]


@dataclass(frozen=True, slots=True)
class _Piece:
    """A part of a route without a change of street or of curvature."""

    x: float  # of the beginning, in the world
    y: float
    yaw_rad: float
    length_m: float
    curvature: float  # radians per metre, positive to the left
    start: Corner  # start and end corner of the leg whose street is visible here
    end: Corner

    def at(self, distance_m: float) -> tuple[float, float, float]:
        """Return x, y and yaw at a distance from the beginning."""
        yaw = self.yaw_rad + self.curvature * distance_m
        if not self.curvature:
            along = distance_m
            return self.x + along * math.cos(yaw), self.y + along * math.sin(yaw), yaw
        radius = 1 / self.curvature
        return (
            self.x + radius * (math.sin(yaw) - math.sin(self.yaw_rad)),
            self.y - radius * (math.cos(yaw) - math.cos(self.yaw_rad)),
            yaw,
        )


@dataclass(frozen=True)
class Route:
    """
    A route along streets on lines of constant x or constant y; ConvseqError for other corners.

    Every line is one street: a route that returns to it sees the same houses again. Half way
    through a bend, the view changes from one street to the other.
    """

    corners: tuple[Corner, ...]  # x, y in metres: the beginning, each corner, and the end
    seed: int = 0  # of the town and all its streets
    radius_m: float = 6.0  # of the bends
    _pieces: tuple[_Piece, ...] = field(init=False, repr=False, compare=False)
    _starts: tuple[float, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        for (x, y), (next_x, next_y) in pairwise(self.corners):
            if (x == next_x) == (y == next_y):
                raise ConvseqError(f'corners: {x, y} to {next_x, next_y} is not along x or y')
        pieces = tuple(self._lay())
        starts = tuple(accumulate((piece.length_m for piece in pieces), initial=0.0))
        object.__setattr__(self, '_pieces', pieces)
        object.__setattr__(self, '_starts', starts)

    @property
    def length_m(self) -> float:
        """The length along the middle."""
        return self._starts[-1]

    def spot(self, distance_m: float, offset_m: float, yaw_rad: float) -> Spot:
        """Return the spot at a distance, an offset to the left and a yaw against the route."""
        index = min(bisect_right(self._starts, distance_m), len(self._pieces)) - 1
        piece = self._pieces[index]
        x, y, ahead = piece.at(distance_m - self._starts[index])
        x, y = x - offset_m * math.sin(ahead), y + offset_m * math.cos(ahead)
        yaw = ahead + yaw_rad
        (line_x, line_y), (_, end_y) = piece.start, piece.end
        if line_y == end_y:
            return Spot(x, y, yaw, self._street(0, line_y), x, y - line_y, yaw)
        return Spot(x, y, yaw, self._street(1, line_x), y, line_x - x, yaw - math.pi / 2)

    def _street(self, axis: int, line: float) -> Street:
        """Return the street on a line: y = line for axis 0, x = line for axis 1."""
        entropy = (self.seed, axis, round(line * 1000) % (1 << 32))
        seed = np.random.SeedSequence(entropy).generate_state(1)[0]
        return Street(self.length_m, int(seed))

    def _lay(self) -> list[_Piece]:
        pieces = []
        legs = list(pairwise(self.corners))
        before = 0.0
        for index, (start, end) in enumerate(legs):
            yaw = _yaw(start, end)
            ahead = _yaw(*legs[index + 1]) if index + 1 < len(legs) else yaw
            turn = math.remainder(ahead - yaw, math.tau)  # to the left
            after = self.radius_m if turn else 0.0
            length = math.dist(start, end) - before - after
            if length < 0 or abs(turn) > 2:
                raise ConvseqError(f'corners: there is no bend of {self.radius_m:g} m at {end}')
            cos, sin = math.cos(yaw), math.sin(yaw)
            x, y = start[0] + before * cos, start[1] + before * sin
            pieces.append(_Piece(x, y, yaw, length, 0.0, start, end))
            if turn:
                curvature = math.copysign(1 / self.radius_m, turn)
                half = math.pi / 4 * self.radius_m
                x, y = x + length * cos, y + length * sin
                first = _Piece(x, y, yaw, half, curvature, start, end)
                pieces += [first, _Piece(*first.at(half), half, curvature, *legs[index + 1])]
            before = after
        return pieces


def _yaw(start: Corner, end: Corner) -> float:
    return math.atan2(end[1] - start[1], end[0] - start[0])
