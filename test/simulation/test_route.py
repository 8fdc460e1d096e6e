# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A route is continuous, as long as it says, and comes back to the same houses."""

from itertools import pairwise
import math

from convseq_ros.errors import ConvseqError
from convseq_ros.simulation.drive import draw, Drive
from convseq_ros.simulation.route import Route
import numpy as np
import pytest

BLOCK = (
    (10.0, 0.0),
    (60.0, 0.0),
    (60.0, 40.0),
    (0.0, 40.0),
    (0.0, 0.0),
    (60.0, 0.0),
    (60.0, 20.0),
)
ROUTE = Route(BLOCK, seed=3, radius_m=5.0)
LAP_M = 2 * (60 + 40) - 4 * (10 - 2.5 * math.pi)


def test_a_bend_of_a_quarter_circle_replaces_each_corner():
    route = Route(((0.0, 0.0), (20.0, 0.0), (20.0, 30.0)), radius_m=4.0)
    assert route.length_m == pytest.approx(16 + 2 * math.pi + 26)
    middle = route.spot(16 + math.pi, 0.0, 0.0)
    half = 4 * math.sqrt(0.5)
    assert (middle.x, middle.y) == pytest.approx((16 + half, 4 - half))
    assert middle.yaw_rad == pytest.approx(math.pi / 4)


def test_nothing_jumps_but_the_street_that_is_seen():
    step = 0.25
    spots = [ROUTE.spot(at, -1.5, 0.1) for at in np.arange(0, ROUTE.length_m, step)]
    for one, other in pairwise(spots):
        assert math.dist((one.x, one.y), (other.x, other.y)) < 1.5 * step
        assert abs(math.remainder(one.yaw_rad - other.yaw_rad, 2 * math.pi)) < 1.1 * step / 5.0


@pytest.mark.parametrize('distance', [5.0, 52.0, 75.0, 110.0, 170.0])
def test_the_place_in_the_street_is_the_place_in_the_world(distance):
    spot = ROUTE.spot(distance, -1.5, 0.2)
    turned = round(math.remainder(spot.yaw_rad - spot.street_yaw_rad, 2 * math.pi) / (math.pi / 2))
    if turned == 0:
        assert spot.street_x == pytest.approx(spot.x)
        line = spot.y - spot.street_y
    else:
        assert turned == 1 and spot.street_x == pytest.approx(spot.y)
        line = spot.x + spot.street_y
    assert min(abs(line - known) for known in (0.0, 40.0, 60.0)) < 1e-9


def test_the_second_lap_sees_what_the_first_saw():
    first, second = (ROUTE.spot(at, -1.0, 0.0) for at in (20.0, 20.0 + LAP_M))
    assert first.street == second.street
    for name in ('x', 'y', 'street_x', 'street_y'):
        assert getattr(first, name) == pytest.approx(getattr(second, name))
    one, other = (
        next(draw(ROUTE, Drive(start_m=at, num_frames=1, width_px=96, height_px=72))).image.astype(
            float
        )
        for at in (20, 20 + LAP_M)
    )
    assert np.abs(one - other).mean() < 1.0


@pytest.mark.parametrize(
    ('corners', 'told'),
    [
        (((0.0, 0.0),), 'no route'),
        (((0.0, 0.0), (10.0, 5.0)), 'not along x or y'),
        (((0.0, 0.0), (0.0, 0.0)), 'not along x or y'),
        (((0.0, 0.0), (20.0, 0.0), (5.0, 0.0)), 'do not turn back'),
        (((0.0, 0.0), (20.0, 0.0), (20.0, 4.0), (40.0, 4.0)), 'so near'),
    ],
)
def test_what_is_no_route_is_refused(corners, told):
    with pytest.raises(ConvseqError, match=told):
        Route(corners)


def test_lanes_lead_from_one_offset_to_the_next():
    drive = Drive(lanes=((10.0, -1.0), (20.0, 0.0)))
    assert [drive.offset_m(at) for at in (0.0, 10.0, 15.0, 30.0)] == [-1.0, -1.0, -0.5, 0.0]
    assert drive.yaw_rad(15.0) == pytest.approx(math.atan(0.1))
    assert drive.yaw_rad(30.0) == 0.0


@pytest.mark.parametrize('lanes', [((0.0, 5.0),), ((5.0, 0.0), (5.0, 1.0))])
def test_impossible_lanes_are_refused(lanes):
    with pytest.raises(ConvseqError, match='lanes'):
        Drive(lanes=lanes)
