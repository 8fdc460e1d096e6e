# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Streets, routes and drives tell the truth about where they are, and repeat exactly."""

from dataclasses import replace
from itertools import pairwise
import math

from convseq_ros.core.rigid import matrix
from convseq_ros.errors import ConvseqError
from convseq_ros.simulation.drive import draw, Drive
from convseq_ros.simulation.light import LIGHTS
from convseq_ros.simulation.route import Route
from convseq_ros.simulation.street import Street
import numpy as np
import pytest

STREET = Street(300.0, 5)
ACROSS = 90.0  # quick to draw: little is in sight
ROUTE = Route(  # a block, and half of it again
    ((10.0, 0.0), (60.0, 0.0), (60.0, 40.0), (0.0, 40.0), (0.0, 0.0), (60.0, 0.0), (60.0, 20.0)),
    seed=3, radius_m=5.0,
)  # fmt: skip
SMALL = Drive(num_frames=3, width_px=96, height_px=72, start_m=20.0, heading_deg=ACROSS)


def test_distances_stamps_and_poses_agree_with_the_speed():
    drive = replace(
        SMALL, num_frames=7, speed_mps=8.0, frame_rate_hz=30.0, heading_deg=20.0, start_ns=123
    )
    shots = list(draw(STREET, drive))
    assert len(shots) == 7
    for index, shot in enumerate(shots):
        seconds = (shot.stamp_ns - 123) / 1e9
        assert seconds == pytest.approx(index / 30.0, abs=1e-9)
        assert shot.distance_m == pytest.approx(20.0 + 8.0 * seconds, abs=1e-7)
        assert shot.pose.position == (shot.distance_m, -1.5, 0.0)
        assert 2 * math.atan2(shot.pose.orientation[2], shot.pose.orientation[3]) == (
            pytest.approx(math.radians(20.0))
        )


@pytest.mark.parametrize('light', LIGHTS)
def test_every_light_gives_a_picture_that_is_the_same_each_time(light):
    one, again = (next(draw(STREET, replace(SMALL, light=light))) for _ in range(2))
    assert one.image.std() > 8 and np.array_equal(one.image, again.image)
    assert (one.stamp_ns, one.pose) == (again.stamp_ns, again.pose)


IMPOSSIBLE = [  # of what, what of it, and what is said
    *(
        (SMALL, wrong, next(iter(wrong)))
        for wrong in (
            {'light': 'noon'}, {'frame_rate_hz': 0.0}, {'width_px': 0}, {'num_frames': -1},
            {'speed_mps': math.nan}, {'start_m': math.nan}, {'lane_offset_m': 4.0},
            {'field_of_view_deg': 180.0}, {'lanes': ((0.0, 5.0),)},
            {'lanes': ((5.0, 0.0), (5.0, 1.0))},
        )
    ),
    *(
        (STREET, wrong, next(iter(wrong)))
        for wrong in (
            {'length_m': 0.0}, {'length_m': -5.0}, {'length_m': math.nan}, {'seed': -1},
            {'things_seed': -1}, {'alike': 1.5}, {'alike': math.nan},
        )
    ),
    (ROUTE, {'corners': ((0.0, 0.0), (10.0, 5.0))}, 'not along x or y'),
    (ROUTE, {'corners': ((0.0, 0.0), (0.0, 0.0))}, 'not along x or y'),
    (ROUTE, {'corners': ((0.0, 0.0), (20.0, 0.0), (5.0, 0.0))}, 'there is no bend'),
    (ROUTE, {'corners': ((0.0, 0.0), (20.0, 0.0), (20.0, 4.0), (40.0, 4.0))}, 'there is no bend'),
]  # fmt: skip


@pytest.mark.parametrize(('world', 'wrong', 'told'), IMPOSSIBLE)
def test_what_cannot_be_is_refused_by_name(world, wrong, told):
    with pytest.raises(ConvseqError, match=told):
        replace(world, **wrong)


def test_a_rear_camera_on_the_way_back_sees_what_a_front_camera_saw():
    ahead = list(draw(STREET, replace(SMALL, heading_deg=0.0, speed_mps=10.0)))
    back = replace(SMALL, heading_deg=180.0, camera_yaw_deg=180.0, start_m=22.0, speed_mps=-10.0)
    shots = list(draw(STREET, back))
    assert [shot.distance_m for shot in shots] == [22.0, 21.0, 20.0]
    for one, other in zip(ahead, shots[::-1], strict=True):
        noise = np.abs(one.image.astype(float) - other.image).mean()
        assert one.pose.position == other.pose.position and noise < 4.0
        # The base is turned round, and the camera on it, too.
        turned = matrix(other.pose) @ matrix(other.camera.mount)
        np.testing.assert_allclose(turned, matrix(one.pose), atol=1e-9)


@pytest.mark.parametrize(
    ('speed_mps', 'told'),
    [(40.0, 'longer street'), (-10.0, 'ends at -80 m, before the street begins')],
)
def test_a_drive_beyond_an_end_of_the_street_is_refused(speed_mps, told):
    with pytest.raises(ConvseqError, match=told):
        next(draw(STREET, replace(SMALL, num_frames=101, speed_mps=speed_mps)))


@pytest.mark.parametrize('light', ['day', 'night'])
def test_a_twin_has_the_same_houses_and_things_of_its_own(light):
    street = Street(500.0, 3)
    one, other, own = (
        replace(street, things_seed=things, alike=alike).stretch(2, LIGHTS[light])
        for things, alike in ((None, 1.0), (7, 1.0), (7, 0.5))
    )

    def told(panels, *names):
        return [[getattr(panel, name) for name in names] for panel in panels]

    shape, paint = ('start', 'end', 'top', 'lamps'), ('seed',)
    assert told(one.buildings, *shape, *paint) == told(other.buildings, *shape, *paint)
    assert told(one.things, 'start') != told(other.things, 'start')
    assert one.things[0].lamps == other.things[-1].lamps
    assert told(one.buildings, *shape) == told(own.buildings, *shape)
    same = [a == b for a, b in zip(*(told(s.buildings, *paint) for s in (one, own)), strict=True)]
    assert 0.3 < sum(same) / len(same) < 0.7


LAP_M = 2 * (60 + 40) - 4 * (10 - 2.5 * math.pi)


def test_a_bend_of_a_quarter_circle_replaces_each_corner():
    route = Route(((0.0, 0.0), (20.0, 0.0), (20.0, 30.0)), radius_m=4.0)
    assert route.length_m == pytest.approx(16 + 2 * math.pi + 26)
    middle = route.spot(16 + math.pi, 0.0, 0.0)
    half = 4 * math.sqrt(0.5)
    assert (middle.x, middle.y) == pytest.approx((16 + half, 4 - half))
    assert middle.yaw_rad == pytest.approx(math.pi / 4)


def test_the_pose_along_a_route_never_jumps():
    step = 0.25
    spots = [ROUTE.spot(at, -1.5, 0.1) for at in np.arange(0, ROUTE.length_m, step)]
    for one, other in pairwise(spots):
        assert math.dist((one.x, one.y), (other.x, other.y)) < 1.5 * step
        assert abs(math.remainder(one.yaw_rad - other.yaw_rad, 2 * math.pi)) < 1.1 * step / 5.0


@pytest.mark.parametrize('distance', [5.0, 52.0, 75.0, 110.0, 170.0])
def test_the_place_in_the_street_is_the_place_in_the_world(distance):
    spot = ROUTE.spot(distance, -1.5, 0.2)
    turned = round(math.remainder(spot.yaw_rad - spot.street_yaw_rad, 2 * math.pi) / (math.pi / 2))
    assert turned in (0, 1)
    along, line = ((spot.x, spot.y - spot.street_y), (spot.y, spot.x + spot.street_y))[turned]
    assert spot.street_x == pytest.approx(along)
    assert min(abs(line - known) for known in (0.0, 40.0, 60.0)) < 1e-9


def test_the_second_lap_sees_what_the_first_saw():
    laps = 20.0, 20.0 + LAP_M
    first, second = (ROUTE.spot(at, -1.0, 0.0) for at in laps)
    assert first.street == second.street
    for name in ('x', 'y', 'street_x', 'street_y'):
        assert getattr(first, name) == pytest.approx(getattr(second, name))
    drives = (Drive(start_m=at, num_frames=1, width_px=96, height_px=72) for at in laps)
    one, other = (next(draw(ROUTE, drive)).image.astype(float) for drive in drives)
    assert np.abs(one - other).mean() < 1.0


def test_lanes_lead_from_one_offset_to_the_next():
    drive = Drive(lanes=((10.0, -1.0), (20.0, 0.0)))
    assert [drive.offset_m(at) for at in (0.0, 10.0, 15.0, 30.0)] == [-1.0, -1.0, -0.5, 0.0]
    assert drive.yaw_rad(15.0) == pytest.approx(math.atan(0.1))
    assert drive.yaw_rad(30.0) == 0.0
