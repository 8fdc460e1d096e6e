# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A street of any length; nothing of it is kept, all follows from its seed."""

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
    """
    A stretch of the street in one light.

    Parameters
    ----------
    buildings : list of Panel
        Everything on and behind the line of the facades.
    things : list of Panel
        Everything in front of them.
    ground : callable
        Makes the road's texture.

    """

    buildings: list[Panel]
    things: list[Panel]
    make_ground: Callable[[], Texture]

    @cached_property
    def ground(self) -> Texture:
        """The road from above, x to the right and the left side of the street up."""
        return self.make_ground()


@dataclass(frozen=True, slots=True)
class Spot:
    """
    Where a camera stands, in the world and in the street that it sees.

    Parameters
    ----------
    x, y, yaw_rad : float
        In the world: metres, and counter-clockwise from its x axis.
    street : Street
        What is seen from there.
    street_x, street_y, street_yaw_rad : float
        The same place in that street's own axes.

    """

    x: float
    y: float
    yaw_rad: float
    street: 'Street'
    street_x: float
    street_y: float
    street_yaw_rad: float


@dataclass(frozen=True, slots=True)
class Street:
    """
    A straight street along x, its middle at y = 0, left positive.

    Parameters
    ----------
    length_m : float
        How far it may be driven; what one sees goes on beyond.
    seed : int
        Decides the whole street.
    things_seed : int, optional
        Decides trees, parked cars, signs and the road instead: streets that differ in it alone are
        twins, with the same houses and lamps.
    alike : float
        Share of the fronts and sides of houses that are painted as its twins' are; all have the
        same shape.

    """

    length_m: float
    seed: int = 0
    things_seed: int | None = None
    alike: float = 1.0

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
