# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Poses of a drawn street, whose truth is exact, and what bad input makes of them."""

from dataclasses import replace
import math

from convseq_ros.config import AcceptanceConfig, Config, EVERY_FRAME, RobotConfig
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.encoding.view import upright
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map_builder import build_map
from convseq_ros.core.matcher import make_matcher
from convseq_ros.core.pose.relative_pose import RelativePoses
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.core.rigid import inverse, matrix, of_roll_pitch_yaw, pose_of
from convseq_ros.core.types import Candidate, Pose, Reason
import cv2
import numpy as np
import pytest

from test.core.measured_pose import drawn_street, measured, off


@pytest.fixture(scope='module')
def street():
    return drawn_street()


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
def test_a_drawn_street_tells_the_pose_in_metres(street, made, index):
    query = street[1][9]
    pose = made(query, index)
    metres, radians = off(pose, query, street[0][index])
    assert metres < 0.45 and radians < 0.02
    assert 0.02 < pose.position_sigma_m < 0.5 and 0.001 < pose.heading_sigma_rad < 0.03
    assert pose.inliers > 100
    assert pose.direction @ np.array(pose.position_m) == pytest.approx(
        np.linalg.norm(pose.position_m)
    )
    assert (np.linalg.eigvalsh(pose.covariance) > 0).all()


def test_a_map_without_poses_gives_no_metres(street, made):
    bare = [replace(one, pose=None) for one in street[0]]
    pose = made(street[1][9], 11, bare)
    assert pose.position_m is None and pose.covariance[0, 0] == 1e6
    assert math.hypot(*pose.orientation) == pytest.approx(1)


@pytest.mark.parametrize('wrong', [{'fx_px': math.nan}, {'fy_px': 0.0}, {'width_px': -1}])
def test_a_camera_of_impossible_numbers_measures_nothing(street, made, wrong):
    query = street[1][9]
    assert made(replace(query, camera=replace(query.camera, **wrong)), 11) is None


def test_the_same_image_is_at_the_same_spot(street, made):
    pose = made(street[0][11], 11)
    assert math.hypot(*pose.position_m) < 0.05
    bare = [replace(one, pose=None) for one in street[0]]
    assert made(street[0][11], 11, bare).direction is None


def test_distortion_is_taken_out(street, made):
    """An image that is distorted, with its camera's coefficients, is at the same spot."""
    query = street[1][9]
    numbers = np.array((-0.25, 0.06, 0.0, 0.0))
    camera = query.camera
    lens = np.array([[camera.fx_px, 0, camera.cx_px], [0, camera.fy_px, camera.cy_px], [0, 0, 1]])
    pixels = np.indices((240, 320)).reshape(2, -1).T[:, None, ::-1].astype(np.float64)
    straight = cv2.undistortPoints(pixels, lens, numbers, P=lens).reshape(240, 320, 2)
    bent = cv2.remap(query.gray, straight.astype(np.float32), None, cv2.INTER_LINEAR)
    told = replace(camera, distortion_model='plumb_bob', distortion=tuple(numbers.tolist()))
    with_numbers = made(replace(query, gray=bent, camera=told), 11)
    without = made(replace(query, gray=bent), 11)
    right_m = off(with_numbers, query, street[0][11])[0]
    assert right_m < 0.45
    if without is not None and without.position_m is not None:
        assert right_m < off(without, query, street[0][11])[0]


def test_poses_are_of_the_base(street):
    """A camera that looks to the left of the base, ahead of it: the same poses of the base."""
    mount = of_roll_pitch_yaw((0.5, 0.1, 0.3), 0.0, 0.0, 0.4)
    config = Config(keyframes=EVERY_FRAME, robot=RobotConfig(camera_to_base='0.5 0.1 0.3 0 0 0.4'))

    def on_base(frame):
        return replace(frame, pose=pose_of(matrix(frame.pose) @ inverse(matrix(mount))))

    found = []
    for robot, frames in ((config, [on_base(one) for one in street[0]]), (Config(), street[0])):
        settings = replace(robot, keyframes=EVERY_FRAME)
        reference_map = build_map(frames, None, settings)
        place = reference_map.places[11]
        query = street[1][9] if robot is not config else on_base(street[1][9])
        matcher = make_matcher(reference_map, settings)
        shown = upright(query, reference_map.encoding, settings.robot)
        features = matcher.extract(describe(query.gray))
        candidate = Candidate(11, 0, 1.0, matcher.shift(features, 11))
        pose = RelativePoses(reference_map, matcher).measure(features, shown, candidate)
        found.append(matrix(place.pose) @ matrix(Pose(pose.position_m, pose.orientation)))
    assert found[0] @ matrix(mount) == pytest.approx(found[1], abs=1e-5)


def test_accepted_matches_are_measured_alike_from_a_file_and_repeatably(street, tmp_path):
    config = Config(keyframes=EVERY_FRAME)
    in_memory = build_map(street[0], None, config)
    build_map(street[0], tmp_path / 'a.map', config)
    poses = []
    for reference_map in (in_memory, open_map(tmp_path / 'a.map')):
        recognizer = PlaceRecognizer(reference_map, config)
        matches = [recognizer.process(frame) for frame in street[1]]
        poses.append([one.relative_pose for one in matches if one.accepted])
        for frame, match in zip(street[1], matches, strict=True):
            if match.accepted:
                place = reference_map.places[match.accepted.reference_index]
                assert off(match.relative_pose, frame, place)[0] < 1.0
    assert len(poses[0]) > 8
    assert [one.position_m for one in poses[0]] == [one.position_m for one in poses[1]]


def test_a_match_that_odometry_denies_is_implausible(street):
    config = Config(keyframes=EVERY_FRAME)
    recognizer = PlaceRecognizer(build_map(street[0], None, config), config)
    reasons = []
    for number, frame in enumerate(street[1]):
        # After 14 frames odometry says that the robot drives away to the side, faster and faster.
        x, _, z = frame.pose.position
        aside = Pose((x, max(0, number - 14) ** 2 * 80.0, z), frame.pose.orientation)
        match = recognizer.process(replace(frame, pose=aside))
        reasons.append(match.reason)
        assert (match.implausible_m is not None) == (match.reason is Reason.IMPLAUSIBLE)
    assert Reason.IMPLAUSIBLE in reasons[15:] and Reason.IMPLAUSIBLE not in reasons[:15]


def test_a_refused_match_delays_no_other(street):
    acceptance = AcceptanceConfig(closure_interval_s=0.3)
    config = Config(keyframes=EVERY_FRAME, acceptance=acceptance)
    reference_map = build_map(street[0], None, config)

    def driven(wrong=None):
        recognizer = PlaceRecognizer(reference_map, config)
        aside = {wrong: Pose((0.0, 500.0, 0.0), (0.0, 0.0, 0.0, 1.0))}
        return [
            recognizer.process(replace(frame, pose=aside.get(number, frame.pose))).reason
            for number, frame in enumerate(street[1])
        ]

    accepted = [number for number, one in enumerate(driven()) if one is Reason.ACCEPTED]
    assert len(accepted) > 2 and min(np.diff(accepted)) > 1
    refused = accepted[1]
    # Odometry that is back is a jump, too; after it the interval has long passed.
    found = driven(refused)[refused : refused + 3]
    assert found == [Reason.IMPLAUSIBLE, Reason.WEAK, Reason.ACCEPTED]
