# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What kept images add to the pose of a drawn street, and what damaged ones take away."""

from dataclasses import replace
from types import SimpleNamespace

from convseq_ros import build_map, Config, open_map, PlaceRecognizer
from convseq_ros.config import EVERY_FRAME
from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.core.map.reader import MapReader
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.session_slice import joined, slices_of
from convseq_ros.core.map.writer import save_map
from convseq_ros.core.pose.estimate import MapMotion
from convseq_ros.core.pose.image_pose import (
    ImagePoses,
    KEYPOINT,
    KeypointView,
    matched_keypoints,
    SiftKeypoints,
)
from convseq_ros.core.rigid import inverse, matrix, ROBOT_LENS
from convseq_ros.core.types import Camera
import cv2
from measured_pose import measured, off
import numpy as np
import pytest

KEEPS = Config(keyframes=replace(EVERY_FRAME, keep_images_px=320))


@pytest.fixture(scope='module')
def whole(street):
    return build_map(street[0], None, KEEPS)


def changed(whole, change):
    """Return a map whose images a function from index and JPEG makes."""
    made = ReferenceMap(whole.encoding)
    made.begin_session(0, whole.sessions[0].camera)
    for index, place in enumerate(whole.places):
        (picture,) = whole.pictures([index])
        made.add(place, picture.packed, image=change(index, picture.image))
    return made


@pytest.mark.parametrize('index', [9, 11, 12])
def test_kept_images_give_the_pose_to_5_cm(street, whole, index):
    query = street[1][9]
    pose, again = (measured(whole, query, index) for _ in range(2))
    metres, radians = off(pose, query, whole.places[index])
    assert metres < 0.05 and radians < 0.003
    assert 0.001 < pose.position_sigma_m < 0.05
    assert pose.position_m == again.position_m
    assert np.array_equal(pose.covariance, again.covariance)


def test_from_a_guess_that_is_20_m_off_points_with_depth_give_a_start(street, whole):
    query, guess = street[1][9], np.eye(4)
    guess[2, 3] = -20.0
    found = ImagePoses(whole, MapMotion(whole), 64.0).align(11, query.camera, query, guess)
    there = inverse(matrix(whole.places[11].pose)) @ matrix(query.pose)
    expected = inverse(ROBOT_LENS) @ there @ ROBOT_LENS
    assert np.linalg.norm((inverse(found.moved) - expected)[:3, 3]) < 0.05


def test_cells_give_the_pose_where_keypoints_do_not_agree(street, whole):
    """Each fallback is the very answer of a map without images."""
    query = street[1][9]
    plain = measured(changed(whole, lambda *_: None), query, 11)
    noise = np.random.default_rng(0).integers(0, 256, (240, 320), np.uint8)
    blank, noise = (cv2.imencode('.jpg', one)[1].tobytes() for one in (0 * noise + 128, noise))
    changes = (
        lambda *_: blank,
        lambda at, jpeg: jpeg[:at],
        lambda at, jpeg: jpeg if at == 11 else None,
        lambda *_: noise,
    )
    others = [changed(whole, change) for change in changes]
    for other in others:
        pose = measured(other, query, 11)
        assert pose.position_m == plain.position_m and pose.inliers == plain.inliers
    assert others[1].unreadable and 'reference' in others[1].unreadable_why
    assert not others[0].unreadable
    pose = measured(whole, query, 11, ReadingConfig(max_image_mpx=0.05))
    assert pose.position_m == plain.position_m and 'max_image_mpx' in whole.unreadable_why


def test_the_robots_own_body_has_no_keypoints(street, whole):
    """A bonnet that is painted over the same place of all images says: the same pose."""

    def with_bonnet(frame):
        gray = frame.gray.copy()
        gray[160:] = np.random.default_rng(0).integers(0, 256, (80, 320), np.uint8)
        return replace(frame, gray=gray)

    visible = np.ones((32, 32), np.bool_)
    visible[21:] = False
    hidden = f'#{np.packbits(visible).tobytes().hex()}'
    config = replace(KEEPS, encoding=replace(KEEPS.encoding, image_mask=hidden))
    masked = build_map([with_bonnet(one) for one in street[0]], None, config)
    query = with_bonnet(street[1][9])
    pose = measured(masked, query, 11)
    assert off(pose, query, masked.places[11])[0] < 0.05


@pytest.mark.once
def test_a_file_keeps_images_and_answers_as_memory_does(street, whole, tmp_path):
    path = tmp_path / 'map.sqlite'
    build_map(street[0], path, KEEPS)
    opened = open_map(path)
    assert opened.pictures([3], True)[0].image == whole.pictures([3])[0].image
    merged = tmp_path / 'merged.sqlite'
    save_map(joined(slices_of(path)), merged, is_new=True)
    about = MapReader(merged).about()
    assert about['images'] == len(whole) and 5_000 < about['image_bytes'] / len(whole) < 20_000
    config = replace(KEEPS, keyframes=EVERY_FRAME)
    answers = []
    for one in (whole, open_map(merged)):
        recognizer = PlaceRecognizer(one, config)
        answers.append([recognizer.process(frame).relative_pose for frame in street[1][5:13]])
    known = [one for one in answers[0] if one]
    assert known and all(one.position_sigma_m < 0.05 for one in known)
    for one, other in zip(*answers, strict=True):
        assert (one is None) == (other is None)
        assert one is None or one.position_m == other.position_m


def test_units_of_keypoints_are_those_of_the_image_that_was_searched():
    camera = Camera(640, 480, 500.0, 400.0, 320.0, 240.0)
    view = KeypointView(camera, SimpleNamespace(size_px=(320, 120)))
    assert view.scale * KEYPOINT.unit_px == pytest.approx([250, 100])


def test_keypoints_match_that_are_mutual_and_clearly_nearer_than_the_second():
    rows = [(0, 0), (50, 0), (100, 0)], [(8, 0), (0, 10), (50, 0), (109, 0), (100, 10)]
    first, second = (
        SiftKeypoints(np.zeros((len(one), 2)), np.array(one, np.float32), (1, 1)) for one in rows
    )
    # 8 of 10 are clear, and 9 of 10 are not.
    assert matched_keypoints(first, second).tolist() == [[0, 0], [1, 2]]


def test_a_match_off_its_epipolar_line_is_left_out():
    rng, moved = np.random.default_rng(0), np.eye(4)
    moved[:3, 3] = -1.0, 0.2, 0.1
    camera = Camera(640, 480, 500.0, 500.0, 320.0, 240.0)
    points = rng.uniform((-2, -1.5, 4), (2, 1.5, 12), (60, 3))
    views = []
    for view in (points, points + moved[:3, 3]):
        pixels = 500 * view[:, :2] / view[:, 2:] + (320, 240)
        shares, descriptors = pixels / (640, 480), 100 * np.eye(60, dtype=np.float32)
        views.append(KeypointView(camera, SiftKeypoints(shares, descriptors, (640, 480))))
    views[1].keypoints.shares[7] += 0.0, 0.1
    found = views[0].sight_of_scene(views[1], moved).observed
    assert np.flatnonzero(np.isnan(found).any(axis=1)).tolist() == [7]
