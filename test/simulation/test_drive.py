# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Drives tell the truth about where they are, and repeat exactly."""

from dataclasses import replace
import math

from convseq_ros.core.rigid import matrix
from convseq_ros.errors import ConvseqError
from convseq_ros.simulation.drive import draw, Drive
from convseq_ros.simulation.light import LIGHTS
from convseq_ros.simulation.street import Street
import numpy as np
import pytest

STREET = Street(300.0, 5)
ACROSS = 90.0  # quick to draw: little is in sight
SMALL = Drive(num_frames=3, width_px=96, height_px=72, start_m=20.0, heading_deg=ACROSS)


def test_two_drives_with_the_same_settings_agree():
    for one, other in zip(draw(STREET, SMALL), draw(STREET, SMALL), strict=True):
        assert np.array_equal(one.image, other.image)
        assert (one.stamp_ns, one.pose) == (other.stamp_ns, other.pose)


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
def test_every_light_gives_a_picture(light):
    assert next(draw(STREET, replace(SMALL, light=light))).image.std() > 8


@pytest.mark.parametrize(
    'wrong',
    [
        {'light': 'noon'},
        {'frame_rate_hz': 0.0},
        {'width_px': 0},
        {'num_frames': -1},
        {'speed_mps': math.nan},
        {'start_m': math.nan},
        {'lane_offset_m': 4.0},
        {'field_of_view_deg': 180.0},
    ],
)
def test_an_impossible_drive_is_refused_by_name(wrong):
    with pytest.raises(ConvseqError, match=next(iter(wrong))):
        replace(SMALL, **wrong)


def test_a_drive_beyond_the_street_is_refused():
    with pytest.raises(ConvseqError, match='longer street'):
        next(draw(Street(30.0), replace(SMALL, num_frames=100)))


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


def test_a_drive_back_beyond_the_beginning_is_refused():
    with pytest.raises(ConvseqError, match=r'ends at -80 m, before the street begins'):
        next(draw(STREET, replace(SMALL, num_frames=101, speed_mps=-10.0)))
