# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Poses of a drawn street, whose truth is exact, and turns of a camera."""

from dataclasses import replace
import math

from convseq_ros import build_map, Config, open_map, PlaceRecognizer
from convseq_ros.config import EVERY_FRAME, MatchingConfig, RobotConfig, with_values
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.geometry.map_view import upright
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.pose.relative_pose import relative_yaw, RelativePoses, shift_px
from convseq_ros.core.rigid import inverse, matrix, of_roll_pitch_yaw, pose_of
from convseq_ros.core.similarity.matcher import make_matcher, Matcher
from convseq_ros.core.types import Camera, Candidate, Pose, Reason
from convseq_ros.sources.camera_info import fitted
import cv2
from measured_pose import measured, off
import numpy as np
import pytest
from world import map_of


@pytest.fixture(scope='module')
def made(street):
    """Return a function from frames of a map, a query and a place to the pose that is measured."""

    def made_of(query, index, mapped=street[0]):
        reference_map = ReferenceMap()
        for frame in mapped:
            reference_map.add_frame(frame, describe(frame.gray))
        return measured(reference_map, query, index)

    return made_of


@pytest.mark.parametrize('index', [9, 11, 12])
def test_a_drawn_street_gives_the_pose_in_metres(street, made, index):
    query = street[1][9]
    pose = made(query, index)
    metres, radians = off(pose, query, street[0][index])
    assert metres < 0.45 and radians < 0.02
    assert 0.02 < pose.position_sigma_m < 0.5 and 0.001 < pose.heading_sigma_rad < 0.03
    assert pose.inliers > 100
    along = pose.direction @ np.array(pose.position_m)
    assert along == pytest.approx(np.linalg.norm(pose.position_m))
    assert (np.linalg.eigvalsh(pose.covariance) > 0).all()
    # An image of the map is at its own place.
    assert math.hypot(*made(street[0][index], index).position_m) < 0.05


def test_a_map_without_poses_or_a_camera_of_impossible_numbers_gives_none(street, made):
    bare, query = [replace(one, pose=None) for one in street[0]], street[1][9]
    assert made(query, 11, bare) is None
    assert made(replace(query, camera=replace(query.camera, fx_px=math.nan)), 11) is None


def test_the_pose_does_not_depend_on_which_near_place_is_recognised(street, made):
    spots = []
    for index in (9, 10, 11, 13, 14):
        pose = made(street[1][9], index)
        there = matrix(Pose(pose.position_m, pose.orientation))
        spots.append((matrix(street[0][index].pose) @ there)[:3, 3])
    assert np.ptp(spots, axis=0).max() < 0.02


def lens_of(camera):
    return np.array([[camera.fx_px, 0, camera.cx_px], [0, camera.fy_px, camera.cy_px], [0, 0, 1]])


@pytest.mark.parametrize('turn_rad', [0.3, -0.3])
def test_the_search_for_regions_starts_at_the_shift_of_the_image(street, made, turn_rad):
    """A camera that turned to a side shows everything some nine cells further on the other."""
    query, lens = street[1][9], lens_of(street[1][9].camera)
    turn = cv2.Rodrigues(np.array((0.0, turn_rad, 0.0)))[0]
    gray = cv2.warpPerspective(query.gray, lens @ turn @ np.linalg.inv(lens), (320, 240))
    ahead = matrix(query.pose) @ matrix(of_roll_pitch_yaw((0.0, 0.0, 0.0), 0.0, 0.0, turn_rad))
    turned_query = replace(query, gray=gray, pose=pose_of(ahead))
    metres, radians = off(made(turned_query, 11), turned_query, street[0][11])
    assert metres < 0.45 and radians < 0.03


def test_distortion_is_taken_out(street, made):
    """An image that is distorted, with its camera's coefficients, is at the same spot."""
    query = street[1][9]
    numbers, lens = np.array((-0.25, 0.06, 0.0, 0.0)), lens_of(query.camera)
    pixels = np.indices((240, 320)).reshape(2, -1).T[:, None, ::-1].astype(np.float64)
    straight = cv2.undistortPoints(pixels, lens, numbers, P=lens).reshape(240, 320, 2)
    bent = cv2.remap(query.gray, straight.astype(np.float32), None, cv2.INTER_LINEAR)
    told = replace(query.camera, distortion_model='plumb_bob', distortion=tuple(numbers.tolist()))
    pose = made(replace(query, gray=bent, camera=told), 11)
    assert off(pose, query, street[0][11])[0] < 0.45


def test_poses_are_of_the_base(street):
    """A camera that looks to the left of the base, ahead of it: the same poses of the base."""
    mount = matrix(of_roll_pitch_yaw((0.5, 0.1, 0.3), 0.0, 0.0, 0.4))
    found = []
    for text, base in (('0.5 0.1 0.3 0 0 0.4', inverse(mount)), ('0 0 0 0 0 0', np.eye(4))):
        settings = Config(keyframes=EVERY_FRAME, robot=RobotConfig(camera_to_base=text))
        driven = *street[0], street[1][9]
        *frames, query = (replace(one, pose=pose_of(matrix(one.pose) @ base)) for one in driven)
        reference_map = build_map(frames, None, settings)
        matcher = make_matcher(reference_map, settings)
        shown = upright(query, reference_map.encoding, settings.robot)
        features = matcher.extract(describe(query.gray))
        candidate = Candidate(11, 0, 1.0, matcher.shift(features, 11))
        pose = RelativePoses(reference_map, matcher).measure(features, shown, candidate)
        there = matrix(Pose(pose.position_m, pose.orientation))
        found.append(matrix(reference_map.places[11].pose) @ there)
    assert found[0] @ mount == pytest.approx(found[1], abs=1e-5)


def test_accepted_matches_are_measured_alike_from_a_file_and_repeatably(street, tmp_path):
    config = Config(keyframes=EVERY_FRAME)
    in_memory = build_map(street[0], None, config)
    build_map(street[0], tmp_path / 'a.map', config)
    positions = []
    for reference_map in (in_memory, open_map(tmp_path / 'a.map')):
        recognizer, found = PlaceRecognizer(reference_map, config), []
        for frame in street[1]:
            match = recognizer.process(frame)
            if match.accepted:
                found.append(match.relative_pose.position_m)
                place = reference_map.places[match.accepted.reference_index]
                assert off(match.relative_pose, frame, place)[0] < 1.0
        positions.append(found)
    assert len(positions[0]) > 8 and positions[0] == positions[1]


@pytest.mark.once
def test_a_match_that_odometry_denies_is_implausible(street):
    config = with_values(Config(keyframes=EVERY_FRAME), {'min_confidence': 0.999})
    recognizer = PlaceRecognizer(build_map(street[0], None, config), config)
    reasons = []
    for number, frame in enumerate(street[1]):
        if 14 < number < 20:
            continue  # no images while, by odometry, the robot drives away to the side
        x, _, z = frame.pose.position
        aside = Pose((x, max(0, number - 14) * 3.5, z), frame.pose.orientation)
        match = recognizer.process(replace(frame, pose=aside))
        reasons.append(match.reason)
        if match.implausible_m is not None:
            assert match.accepted or match.reason is Reason.IMPLAUSIBLE
    assert Reason.IMPLAUSIBLE in reasons[15:] and Reason.IMPLAUSIBLE not in reasons[:15]


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


def image_at(scene, yaw):
    """Return what a pinhole camera at the middle of the scene sees, turned to the left by yaw."""
    sine, cosine = math.sin(yaw), math.cos(yaw)
    # Camera axes: x right, y down, z forward. Directions of the turned camera in those of the
    # straight one: what lies ahead of it lies to the left of the other.
    turned_to_straight = np.array([[cosine, 0, -sine], [0, 1, 0], [sine, 0, cosine]])
    own = np.array([[500.0, 0, WIDTH / 2], [0, 500.0, HEIGHT / 2], [0, 0, 1]])
    wide = np.array([[500.0, 0, 800.0], [0, 500.0, 450.0], [0, 0, 1]])
    to_scene = wide @ turned_to_straight @ np.linalg.inv(own)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return cv2.warpPerspective(scene, to_scene, (WIDTH, HEIGHT), flags=flags)


def measured_px(query, reference):
    """Return the shift that coherent matching finds, in pixels of the query."""
    reference_map = map_of([describe(reference)])
    matcher = Matcher(reference_map, MatchingConfig(matching='coherent'), 0.5)
    shift = matcher.shift(matcher.extract(describe(query)), 0)
    return shift_px(shift, *query.shape, CELLS)


@pytest.mark.parametrize('degrees', [-16, 0, 8])
def test_a_camera_turned_to_the_left_has_a_positive_yaw(scene, degrees):
    query, reference = image_at(scene, math.radians(degrees)), image_at(scene, 0.0)
    yaw = relative_yaw(measured_px(query, reference), CAMERA)
    a_cell = math.atan(CELL_PX / CAMERA.fx_px)
    assert yaw == pytest.approx(math.radians(degrees), abs=0.7 * a_cell)
    there_and_back = relative_yaw(measured_px(reference, query), CAMERA)
    assert there_and_back == pytest.approx(-yaw, abs=a_cell)


def test_a_known_shift_is_a_known_angle_also_of_smaller_images():
    # tan(22.5 deg) * 500 px on either side of the axis.
    half_px = 500 * math.tan(math.radians(22.5))
    assert shift_px((2.0, -3.0), HEIGHT, WIDTH, CELLS) == (30.0, -60.0)
    assert relative_yaw((17.0, -2 * half_px), CAMERA) == pytest.approx(math.radians(45))
    assert relative_yaw((0.0, 100.0), CAMERA) == -relative_yaw((0.0, -100.0), CAMERA)
    small = fitted(CAMERA, HEIGHT // 2, WIDTH // 2)
    assert small == Camera(320, 240, 250.0, 250.0, 160.0, 120.0)
    assert fitted(CAMERA, HEIGHT, WIDTH) is CAMERA
    assert relative_yaw((0.0, 10.0), small) == pytest.approx(relative_yaw((0.0, 20.0), CAMERA))
