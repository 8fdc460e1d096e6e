# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Shifts in pixels and as relative yaw, on drawn images."""

import math

from convseq_ros.config import MatchingConfig
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.map.place import pack_cells, Place
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.matcher import Matcher
from convseq_ros.core.pose.estimate import relative_yaw, shift_px
from convseq_ros.core.types import Camera
from convseq_ros.sources.camera_info import fitted
import cv2
import numpy as np
import pytest

HEIGHT, WIDTH, CELLS = 480, 640, 32
CAMERA = Camera(WIDTH, HEIGHT, 500.0, 500.0, WIDTH / 2, HEIGHT / 2)
CELL_PX = WIDTH / CELLS


@pytest.fixture(scope='module')
def scene():
    """Return a wide drawn view (900, 1600) whose parts differ."""
    rng = np.random.default_rng(5)
    coarse = cv2.resize(rng.random((40, 70)).astype(np.float32), (1600, 900))
    fine = cv2.GaussianBlur(rng.random((900, 1600)).astype(np.float32), (5, 5), 1.5)
    return cv2.normalize(coarse + 2 * fine, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


def seen_by(scene, yaw):
    """Return what a pinhole camera at the middle of the scene sees, turned to the left by yaw."""
    sine, cosine = math.sin(yaw), math.cos(yaw)
    # Camera axes: x right, y down, z forward. Directions of the turned camera in those of the
    # straight one: what lies ahead of it lies to the left of the other.
    turned_to_straight = np.array([[cosine, 0, -sine], [0, 1, 0], [sine, 0, cosine]])
    own = np.array([[500.0, 0, WIDTH / 2], [0, 500.0, HEIGHT / 2], [0, 0, 1]])
    wide = np.array([[500.0, 0, 800.0], [0, 500.0, 450.0], [0, 0, 1]])
    to_scene = wide @ turned_to_straight @ np.linalg.inv(own)
    return cv2.warpPerspective(
        scene, to_scene, (WIDTH, HEIGHT), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    )


def measured_px(query, reference):
    """Return the shift that coherent matching finds, in pixels of the query."""
    reference_map = ReferenceMap()
    reference_map.add(Place(0), pack_cells(describe(reference).cells))
    matcher = Matcher(reference_map, MatchingConfig(matching='coherent', kernel='numpy'), 0.5)
    shift = matcher.shift(matcher.extract(describe(query)), 0)
    return shift_px(shift, *query.shape, CELLS)


@pytest.mark.parametrize('degrees', [-16, -8, 0, 8, 16])
def test_a_camera_turned_to_the_left_has_a_positive_yaw(scene, degrees):
    query, reference = seen_by(scene, math.radians(degrees)), seen_by(scene, 0.0)
    yaw = relative_yaw(measured_px(query, reference), CAMERA)
    a_cell = math.atan(CELL_PX / CAMERA.fx_px)
    assert yaw == pytest.approx(math.radians(degrees), abs=0.7 * a_cell)
    there_and_back = relative_yaw(measured_px(reference, query), CAMERA)
    assert there_and_back == pytest.approx(-yaw, abs=a_cell)


def test_a_known_shift_is_a_known_angle():
    # tan(22.5 deg) * 500 px on either side of the axis.
    half_px = 500 * math.tan(math.radians(22.5))
    assert relative_yaw((17.0, -2 * half_px), CAMERA) == pytest.approx(math.radians(45))
    assert relative_yaw((0.0, 100.0), CAMERA) == -relative_yaw((0.0, -100.0), CAMERA)


def test_a_camera_is_fitted_to_smaller_images_and_turns_stay_what_they_are():
    small = fitted(CAMERA, HEIGHT // 2, WIDTH // 4)
    assert small == Camera(160, 240, 125.0, 250.0, 80.0, 120.0)
    assert fitted(CAMERA, HEIGHT, WIDTH) is CAMERA
    assert relative_yaw((0.0, 10.0), small) == pytest.approx(relative_yaw((0.0, 40.0), CAMERA))
