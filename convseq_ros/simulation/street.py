# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A street of any length, generated from its seed on demand."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from convseq_ros.errors import ConvseqError
from convseq_ros.simulation.layout import Layout
from convseq_ros.simulation.light import Light
from convseq_ros.simulation.panel import Panel
from convseq_ros.simulation.texture import Texture


@dataclass(eq=False)
class Stretch:
    """A stretch of the street in one light."""

    buildings: list[Panel]  # on and behind the line of the facades
    things: list[Panel]  # in front of the facades
    make_ground: Callable[[], Texture]

    @cached_property
    def ground(self) -> Texture:
        """The road from above, x to the right and the left side of the street up."""
        return self.make_ground()


@dataclass(frozen=True, slots=True)
class Spot:
    """The position of a camera in metres, with its yaw counter-clockwise from the x axis."""

    x: float  # in the world
    y: float
    yaw_rad: float
    street: 'Street'  # the visible street
    street_x: float  # the same position in the axes of that street
    street_y: float
    street_yaw_rad: float


@dataclass(frozen=True, slots=True)
class Street:
    """A street along x, its middle at y = 0; twins have the same `seed`, other `things_seed`."""

    length_m: float  # drivable length; the view continues beyond it
    seed: int = 0  # of the street
    things_seed: int | None = None  # of trees, parked cars, signs and the road
    alike: float = 1.0  # share of house fronts and sides painted as those of twins

    def __post_init__(self) -> None:
        if not self.length_m > 0:
            raise ConvseqError(f'length_m: {self.length_m} is not a street; make it positive')
        for name in ('seed', 'things_seed'):
            if (seed := getattr(self, name) or 0) < 0:
                raise ConvseqError(f'{name}: {seed} is negative; choose 0 or more')
        if not 0 <= self.alike <= 1:
            raise ConvseqError(f'alike: {self.alike} is not a share; choose 0 to 1')

    def spot(self, distance_m: float, offset_m: float, yaw_rad: float) -> Spot:
        """Return the spot at a distance, an offset to the left and a yaw against the street."""
        here = distance_m, offset_m, yaw_rad
        return Spot(*here, self, *here)

    def stretch(self, index: int, light: Light) -> Stretch:
        """Return the stretch from `index` to `index + 1` times `STRETCH_M`."""
        layout = twin = Layout(self.seed, index, light)
        if self.things_seed is not None:
            layout = Layout(self.seed, index, light, repaint=(self.things_seed, 1 - self.alike))
            twin = Layout(self.things_seed, index, light, lamps_seed=self.seed)
        buildings = [*layout.second_row(), *layout.houses(1), *layout.houses(-1)]
        things = [*layout.lamps(), *twin.plants(), *twin.parked(), *twin.signs()]
        return Stretch(buildings, things, twin.ground)
