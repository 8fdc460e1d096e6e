# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What kept images add to the pose of a drawn street, and what damaged ones take away."""

from dataclasses import replace

from convseq_ros.config import Config, EVERY_FRAME
from convseq_ros.core.map.edit import joined, slices_of, write_new
from convseq_ros.core.map.reader import MapReader, open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map_builder import build_map
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.reading_config import ReadingConfig
import cv2
import numpy as np
import pytest

from test.core.measured_pose import drawn_street, measured, off

KEEPS = Config(keyframes=replace(EVERY_FRAME, keep_images_px=320))


@pytest.fixture(scope='module')
def street():
    return drawn_street()


@pytest.fixture(scope='module')
def whole(street):
    return build_map(street[0], None, KEEPS)


def changed(whole, change, poses=True):
    """Return a map whose images a function from index and JPEG makes."""
    made = ReferenceMap(whole.encoding)
    made.begin_session(0, whole.sessions[0].camera)
    for index, place in enumerate(whole.places):
        (picture,) = whole.pictures([index])
        place = place if poses else replace(place, pose=None)
        made.add(place, picture.packed, image=change(index, picture.image))
    return made


@pytest.mark.parametrize('index', [9, 11, 12])
def test_kept_images_tell_the_pose_to_centimetres(street, whole, index):
    query = street[1][9]
    pose = measured(whole, query, index)
    metres, radians = off(pose, query, whole.places[index])
    assert metres < 0.05 and radians < 0.003
    assert 0.001 < pose.position_sigma_m < 0.05
    again = measured(whole, query, index)
    assert pose.position_m == again.position_m and np.array_equal(
        pose.covariance, again.covariance
    )


def test_where_keypoints_do_not_agree_cells_answer(street, whole):
    """Each fallback is the very answer of a map without images."""
    query = street[1][9]
    plain = measured(changed(whole, lambda *_: None), query, 11)
    blank = cv2.imencode('.jpg', np.full((240, 320), 128, np.uint8))[1].tobytes()
    others = [changed(whole, lambda *_: blank), changed(whole, lambda at, jpeg: jpeg[:at])]
    others += [changed(whole, lambda at, jpeg: jpeg if at == 11 else None)]
    noise = np.random.default_rng(0).integers(0, 256, (240, 320), np.uint8)
    noise = cv2.imencode('.jpg', noise)[1].tobytes()
    others += [changed(whole, lambda *_: noise)]
    for other in others:
        pose = measured(other, query, 11)
        assert pose.position_m == plain.position_m and pose.inliers == plain.inliers
    assert others[1].images.unreadable and 'reference' in others[1].images.problem
    assert not others[0].images.unreadable
    pose = measured(whole, query, 11, ReadingConfig(max_image_mpx=0.05))
    assert pose.position_m == plain.position_m and 'max_image_mpx' in whole.images.problem


def test_the_robots_own_body_has_no_keypoints(street, whole):
    """A bonnet that is painted over the same place of all images says: the same pose."""

    def with_bonnet(frame):
        gray = frame.gray.copy()
        gray[160:] = np.random.default_rng(0).integers(0, 256, (80, 320), np.uint8)
        return replace(frame, gray=gray)

    seen = np.ones((32, 32), np.bool_)
    seen[21:] = False
    hidden = f'#{np.packbits(seen).tobytes().hex()}'
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
    write_new(joined(slices_of(path)), merged)
    about = MapReader(merged).about()
    assert about['images'] == len(whole) and 5_000 < about['image_bytes'] / len(whole) < 20_000
    config = replace(KEEPS, keyframes=EVERY_FRAME)
    answers = []
    for one in (whole, open_map(merged)):
        recognizer = PlaceRecognizer(one, config)
        answers.append([recognizer.process(frame).relative_pose for frame in street[1]])
    known = [one for one in answers[0] if one]
    assert known and all(one.position_sigma_m < 0.05 for one in known)
    for one, other in zip(*answers, strict=True):
        assert (one is None) == (other is None)
        assert one is None or one.position_m == other.position_m


def test_nothing_is_read_where_nothing_was_kept(street, whole, tmp_path, monkeypatch):
    asked, read = [], ReferenceMap.pictures

    def pictures(own, indices, with_images=False):
        asked.append(with_images)
        return read(own, indices, with_images)

    build_map(street[0][:12], path := tmp_path / 'map.sqlite', Config(keyframes=EVERY_FRAME))
    monkeypatch.setattr(ReferenceMap, 'pictures', pictures)
    opened = open_map(path)
    assert measured(opened, street[1][7], 9) and asked and True not in asked
    (picture,) = whole.pictures([3])
    opened.add(replace(whole.places[3], session=0), picture.packed, image=picture.image)
    assert opened.images.image(12, 64.0) is not None and True in asked
