# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A street of any length; nothing of it is kept, all follows from its seed."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from convseq_ros.errors import ConvseqError
from convseq_ros.simulation.layout import Layout, Panel
from convseq_ros.simulation.light import Light
from convseq_ros.simulation.texture import Texture


@dataclass(eq=False)
class Stretch:
    """A stretch of the street in one light."""

    buildings: list[Panel]  # everything on and behind the line of the facades
    things: list[Panel]  # everything in front of them
    make_ground: Callable[[], Texture]

    @cached_property
    def ground(self) -> Texture:
        """The road from above, x to the right and the left side of the street up."""
        return self.make_ground()


@dataclass(frozen=True, slots=True)
class Spot:
    """Where a camera stands: in metres, and counter-clockwise from the x axis."""

    x: float  # in the world
    y: float
    yaw_rad: float
    street: 'Street'  # that it sees
    street_x: float  # the same place in that street's own axes
    street_y: float
    street_yaw_rad: float


@dataclass(frozen=True, slots=True)
class Street:
    """A street along x, its middle at y = 0; `things_seed` alone differs between twins."""

    length_m: float  # how far it may be driven; what one sees goes on beyond
    seed: int = 0  # decides the whole street
    things_seed: int | None = None  # instead decides trees, parked cars, signs and the road
    alike: float = 1.0  # share of fronts and sides of houses that are painted as its twins' are

    def __post_init__(self) -> None:
        if not self.length_m > 0:
            raise ConvseqError(f'length_m: {self.length_m} is not a street; make it positive')
        for name in ('seed', 'things_seed'):
            if (seed := getattr(self, name) or 0) < 0:
                raise ConvseqError(f'{name}: {seed} is negative; choose 0 or more')
        if not 0 <= self.alike <= 1:
            raise ConvseqError(f'alike: {self.alike} is not a share; choose 0 to 1')

    def spot(self, distance_m: float, offset_m: float, yaw_rad: float) -> Spot:
        """Return where one is after a distance, so far to the left, turned so far from ahead."""
        here = distance_m, offset_m, yaw_rad
        return Spot(*here, self, *here)

    def stretch(self, index: int, light: Light) -> Stretch:
        """Return what stands between `index` and `index + 1` times `STRETCH_M`."""
        layout = own = Layout(self.seed, index, light)
        if self.things_seed is not None:
            layout = Layout(self.seed, index, light, own=(self.things_seed, 1 - self.alike))
            own = Layout(self.things_seed, index, light, lamps_seed=self.seed)
        buildings = [*layout.second_row(), *layout.houses(1), *layout.houses(-1)]
        things = [*layout.lamps(), *own.plants(), *own.parked(), *own.signs()]
        return Stretch(buildings, things, own.ground)
