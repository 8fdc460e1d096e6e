# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Keypoints: what is detected, what a map keeps of it, and in how many blocks images agree."""

from dataclasses import replace
import math
import sqlite3
from unittest.mock import Mock

from convseq_ros import build_map, Frame, open_map, PlaceRecognizer
from convseq_ros.config import EncodingConfig, EVERY_FRAME, make_config, with_values
from convseq_ros.core.decision.covisibility import KeypointWitness
from convseq_ros.core.decision.expected_lead import ExpectedLead, Light
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.encoding.glance import brightness
from convseq_ros.core.encoding.keypoints import (
    agreeing_blocks,
    common_shift,
    detect,
    Keypoints,
    matched,
)
from convseq_ros.core.map.format import row_crc
from convseq_ros.core.map.reader import MapReader
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.session_slice import joined, slices_of
from convseq_ros.core.map.writer import save_map
from convseq_ros.errors import MapError
import cv2
import numpy as np
from pictures import corners as drawn
from pictures import walls
import pytest

SIDE = 30  # regions of an image across and down; a region is three cells wide
ALL = np.ones((4, 4), bool)
STAYS = np.zeros((2, 3))  # the motion of the cells between an image and itself
SMALL = EncodingConfig(image_size_px=128)
SHOWN = describe(walls(1)[0], SMALL)
OWN = make_config({'image_size_px': 128, 'keyframe_overlap': 1.0})


def keypoints(gray, most=300):
    return Keypoints.of_stored(detect(gray, ALL, most))


def by_hand(*bits, shares=None):
    """Return keypoints by the first few bits of their descriptors."""
    whole = np.zeros((len(bits), 256), np.float32) - 1
    for row, ones in enumerate(bits):
        whole[row, list(ones)] = 1
    return Keypoints(np.full((len(bits), 2), 0.5) if shares is None else shares, whole)


@pytest.mark.parametrize(
    'gray',
    [
        np.zeros((240, 320), np.uint8),
        np.full((240, 320), 255, np.uint8),
        np.zeros((1, 1), np.uint8),
        drawn(1)[:1],
        drawn(1)[:, :1],
        drawn(1, (8000, 640))[:400],  # of 320 x 16 px there is only border
    ],
)
def test_a_blank_or_tiny_image_has_no_keypoints(gray):
    found = detect(gray, ALL, 300)
    assert found.shape == (0, 34) and found.dtype == np.uint8


@pytest.mark.parametrize('size', [(32, 24), (64, 64), (48, 64), (640, 480), (8000, 2000)])
def test_images_of_any_size_have_keypoints_everywhere(size):
    gray = cv2.resize(drawn(2), size, interpolation=cv2.INTER_AREA)
    found = detect(gray, ALL, 300)
    assert 20 < len(found) <= 300
    assert np.ptp(found[:, 0]) > 128 and np.ptp(found[:, 1]) > 64  # of 256


def test_the_strongest_keypoints_are_kept_up_to_the_limit():
    none, few, many, all_ = (detect(drawn(3), ALL, most) for most in (0, 50, 300, 1000))
    assert (len(none), len(few), len(many)) == (0, 50, 300)
    assert {*map(bytes, few)} <= {*map(bytes, all_)}
    assert np.array_equal(detect(drawn(3), ALL, 300), many)  # the same again


def test_a_keypoint_is_stored_in_34_bytes():
    gray = np.full((240, 320), 40, np.uint8)
    gray[96:120, 160:200] = 200  # its corners are at 160 / 320 and 96 / 240, and so on
    stored = detect(gray, ALL, 300)
    assert stored.shape[1] == 34 and len(stored.tobytes()) == 34 * len(stored)
    back = Keypoints.of_stored(stored)
    corners = np.array([[160, 96], [200, 96], [160, 120], [200, 120]]) / (320, 240)
    off = abs(back.shares[:, None] - corners).max(axis=2).min(axis=1)
    assert len(stored) >= 4 and off.max() < 0.05
    assert {*np.unique(back.bits)} == {-1, 1}
    assert np.array_equal(np.packbits(back.bits > 0, axis=1), stored[:, 2:])
    assert (0 < back.shares).all() and (back.shares < 1).all()
    one = Keypoints.of_stored(np.array([[0, 255, *range(32)]], np.uint8))
    assert one.shares.tolist() == [[0.5 / 256, 255.5 / 256]]


def pairs_of(query, place):
    """Return which keypoints of two images match, by their order."""
    numbered = (
        Keypoints(np.indices((len(one.bits), 2))[0] / 256, one.bits) for one in (query, place)
    )
    return (matched(*numbered)[:, ::2] * 256).tolist()


def blocks(query, place, motion=STAYS):
    return agreeing_blocks(matched(query, place), motion, SIDE)


def test_matches_are_mutual_and_clear():
    first = by_hand(range(40), range(100, 140), range(200, 240))
    assert pairs_of(first, first) == [[0, 0], [1, 1], [2, 2]]
    other = by_hand(range(100, 138), range(50, 90), range(36))
    assert pairs_of(first, other) == [[0, 2], [1, 0]]
    # Two alike: the second best is nearly as near as the best.
    assert pairs_of(first, by_hand(range(4, 40), range(35))) == [[0, 0]]
    assert pairs_of(first, by_hand(range(30), range(10, 40), range(200, 240))) == [[2, 2]]
    # Two of the query are nearest to one place; it is nearest to the first.
    twice = by_hand(range(40), range(39), range(100, 140))
    assert pairs_of(twice, by_hand(range(40), range(100, 140))) == [[0, 0], [2, 1]]


@pytest.mark.parametrize('count', [0, 1])
def test_fewer_than_two_keypoints_match_nothing(count):
    few, many = by_hand(*[range(40)] * count), by_hand(range(40), range(100, 140))
    assert matched(few, many).shape == matched(many, few).shape == (0, 4)
    assert blocks(few, many) == 0


def test_an_image_agrees_with_itself_everywhere_and_with_another_nowhere():
    one, other = keypoints(drawn(5)), keypoints(drawn(6))
    itself = blocks(one, one)
    assert itself > 60 and blocks(one, other) < 7
    assert blocks(one, keypoints(drawn(5) // 2 + 30)) > 0.6 * itself


def test_the_common_shift_is_that_of_most_matches():
    moved = np.array([[2, 4], [2, 5], [3, 4], [2, 4], [9, -7], [-8, 1]]) / 32  # down, across
    here = np.full((6, 2), 0.5)
    shift = common_shift(np.hstack((here, here + moved[:, ::-1])), SIDE)
    assert shift == pytest.approx((2, 4))


@pytest.mark.parametrize(('down', 'across'), [(0, 3), (4, 0), (-3, 2)])
def test_keypoints_must_move_as_the_cells_did(down, across):
    """A cell of the image is 10 px across and 7.5 px down."""
    wide = drawn(7, (480, 360))
    rows, columns = round(60 - 7.5 * down), 80 - 10 * across
    one = keypoints(wide[60:300, 80:400])
    moved = keypoints(wide[rows : rows + 240, columns : columns + 320])
    motion = np.array([[down, 0, 0], [across, 0, 0]], float)
    agreed, stayed, back = (blocks(one, moved, by) for by in (motion, STAYS, -motion))
    assert agreed > 60 and max(stayed, back) < agreed / 8


def test_keypoints_agree_with_a_motion_that_expands_from_the_middle():
    """By hand: at a quarter of the image beside its middle, a motion of 8 cells a side."""
    spread = [range(start, start + 20) for start in range(0, 240, 60)]
    here = np.array([[0.25, 0.5], [0.75, 0.5], [0.5, 0.25], [0.5, 0.75]])
    grows = np.array([[0.0, 8, 0], [0, 0, 8]])  # down with the row, across with the column
    # 8 cells of the distance from the middle, as 30 regions and two more cells are a side.
    there = 0.5 + (here - 0.5) * (1 + 8 / SIDE)
    one, other = by_hand(*spread, shares=here), by_hand(*spread, shares=there)
    assert blocks(one, other, grows) == 4
    assert blocks(one, other, grows[::-1]) == 0  # each would move the other way


def test_a_single_common_object_gives_few_agreeing_blocks():
    one, other = drawn(8), drawn(9)
    one[100:140, 100:160] = other[100:140, 100:160] = drawn(10)[100:140, 100:160]
    first, second = keypoints(one, most=1000), keypoints(other, most=1000)
    assert 1 <= blocks(first, second) <= 4 * 4  # of 20 x 15 px
    in_a_block = by_hand(range(20), range(60, 80), shares=np.array([[0.51, 0.51], [0.55, 0.55]]))
    assert blocks(in_a_block, in_a_block) == 1


def frames(count, light=1.0):
    """Return frames of places that have nothing in common, darker by a factor."""
    pictures = [(one * light).astype(np.uint8) for one in walls(count)]
    return [Frame(number * 10**8, one) for number, one in enumerate(pictures)]


@pytest.fixture(scope='module')
def walled():
    return build_map(frames(12), None, OWN)


@pytest.fixture
def saved(path):
    build_map(frames(12), path, OWN)
    return path


def test_a_map_keeps_the_keypoints_of_each_place(walled, saved, tmp_path):
    merged = tmp_path / 'merged.db'
    save_map(joined(slices_of(saved)), merged, is_new=True)
    for file in (saved, merged):
        opened, about = open_map(file), MapReader(file).about()
        kept = [opened.keypoints(index) for index in range(12)]
        for index, one in enumerate(walls(12)):
            assert np.array_equal(kept[index], detect(one, ALL, 300))
            assert np.array_equal(kept[index], walled.keypoints(index))
        assert about['keypoints'] == 12
        assert about['keypoint_bytes'] == 34 * sum(map(len, kept)) > 34 * 12 * 100


def test_masked_parts_of_places_have_no_keypoints():
    visible = np.ones((8, 8), bool)
    visible[4:] = False
    mask = f'#{np.packbits(visible).tobytes().hex()}'
    masked = build_map(frames(1), None, with_values(OWN, {'image_mask': mask}))
    found = masked.keypoints(0)
    assert len(found) > 50 and found[:, 1].max() < 0.52 * 256


@pytest.mark.parametrize(
    ('kept', 'is_whole', 'said'),
    [
        (b'', True, ''),  # none were seen: cells judge
        (b'x' * 35, True, 'reference 9'),
        (b'x' * 33, True, 'reference 9'),
        (b'x' * 34, False, 'reference 9 fails its checksum'),
    ],
)
def test_a_place_whose_keypoints_are_lost_has_none(walled, saved, kept, is_whole, said):
    with sqlite3.connect(saved) as database:
        query = 'SELECT cells, thumbnail FROM pictures WHERE reference_index = 9'
        row = (9, *database.execute(query).fetchone(), kept)
        database.execute('DELETE FROM pictures WHERE reference_index = 9')
        stored = (*row, row_crc(row) if is_whole else 0)
        database.execute('INSERT INTO pictures VALUES (?, ?, ?, ?, ?)', stored)
    database.close()
    opened = open_map(saved)
    witness = KeypointWitness(opened, 300)
    assert opened.keypoints(9) is None
    assert not witness.knows(9) and witness.knows(8)
    assert bool(opened.unreadable) == bool(said) and said in opened.unreadable_why
    assert not is_whole or np.array_equal(opened.cells(9), walled.cells(9))
    assert np.array_equal(opened.keypoints(8), walled.keypoints(8))


def test_the_witness_counts_the_blocks_of_a_frame_and_a_place(walled):
    witness, frame = KeypointWitness(walled, 300), frames(12)[3]
    query = witness.keypoints(frame, describe(frame.gray, SMALL))
    assert witness.blocks(query, 3, STAYS, SIDE) > 30 > 7 > witness.blocks(query, 4, STAYS, SIDE)
    assert witness.blocks(query, 3, None, SIDE) == 0  # the cells found no motion
    # A frame of a map that is linked has no image, but the keypoints of its place.
    stored = replace(describe(frame.gray, SMALL), keypoints=walled.keypoints(3))
    without = Frame(0, None)
    again = witness.keypoints(without, stored)
    assert np.array_equal(again.shares, query.shares) and np.array_equal(again.bits, query.bits)
    assert witness.keypoints(without, describe(frame.gray, SMALL)) is None
    assert KeypointWitness(walled, 0).keypoints(frame, stored) is None


def test_a_brightness_is_of_a_coarse_grid():
    gray = np.zeros((120, 160), np.uint8)
    gray[:, :20] = 100
    assert np.exp(brightness(gray)).tolist() == pytest.approx(([50] + [4] * 3) * 8)
    assert np.array_equal(brightness(gray), brightness(cv2.resize(gray, (320, 240))))
    assert brightness(gray[:1, :1]).shape == (32,)


def difference(seen, shown, places=12, earlier=None):
    """Return the difference of light from the first places, after a frame."""
    seen.observe(shown, SHOWN)
    found = seen.differences(np.arange(places), places if earlier is None else earlier)
    assert (found == found[0]).all()
    return found[0]


@pytest.mark.parametrize('light', [1.0, 0.93, 0.6, 0.2])
def test_the_difference_of_light_is_that_of_the_logarithms_of_brightness(walled, light):
    seen = Light(walled, True)
    found = [difference(seen, one) for one in frames(12, light)]
    # The logarithm is of four levels more than the brightness, which is 80 to 120 here.
    assert found[-1] == pytest.approx(-math.log(light), abs=0.06)


def test_the_light_is_that_of_the_last_frames_and_a_reset_forgets_it(walled):
    seen = Light(walled, True)
    (dim,), (light,) = frames(1, 0.7), frames(1)
    first = difference(seen, dim)
    assert first == pytest.approx(-math.log(0.7), abs=0.06)
    assert difference(seen, light) == pytest.approx(first / 2, abs=0.06)
    assert difference(seen, Frame(1, None)) == pytest.approx(first / 2, abs=0.06)
    seen.reset()
    assert difference(seen, light) < 0.06
    for _ in range(100):
        difference(seen, light)
    fallen = [difference(seen, dim) for _ in range(20)]
    assert fallen[0] < 0.08 < 0.2 < fallen[9] < fallen[19]  # ten frames, whatever was before


def test_where_light_changes_as_from_day_to_night_frames_before_do_not_count(walled):
    seen = Light(walled, True)
    (light,), (night,) = frames(1), frames(1, 0.2)
    for _ in range(100):
        difference(seen, light)
    assert difference(seen, night) == pytest.approx(math.log(5), abs=0.2)
    assert difference(seen, light) < 0.06


def test_without_thumbnails_or_images_the_light_is_unknown(walled):
    keyframes = replace(EVERY_FRAME, thumbnail_width_px=0)
    bare = build_map(frames(3), None, replace(OWN, keyframes=keyframes))
    shown = frames(1)[0]
    assert difference(Light(bare, True), shown, 3) == math.inf
    assert difference(Light(walled, True), Frame(0, None)) == math.inf
    assert difference(Light(walled, False), shown) == math.inf
    assert difference(Light(walled, False), shown, earlier=0) == 0  # of the running drive


def test_each_session_has_a_light_of_its_own_and_the_running_drive_is_in_the_same():
    """Shade along a walk by day differs from sun as much as night from day."""
    grown = ReferenceMap(SMALL)
    seen = Light(grown, True)
    for session, light in enumerate((1.0, 0.2)):
        if session:
            grown.begin_session('night')
        for frame in frames(30, light):
            seen.observe(frame, SHOWN)
            grown.add_frame(frame, SHOWN, 64)
    assert seen.differences(np.arange(60), 0).tolist() == [0] * 60
    seen.reset()
    seen.observe(frames(1)[0], SHOWN)
    by_day, by_night = seen.differences(np.array([1, 31]), 60)  # as of earlier drives
    assert by_day < 0.06 and by_night == pytest.approx(math.log(5), abs=0.2)


def test_without_keypoints_cells_decide_alone_and_no_lead_is_learned(monkeypatch):
    def answers(config):
        recognizer = PlaceRecognizer(build_map(frames(40), None, config), config)
        return recognizer.reference_map, [recognizer.process(one) for one in frames(30)[10:]]

    learned = []  # of each match that keypoints verified: whether its place is of this drive
    learn = Mock(side_effect=lambda _, place, earlier: learned.append(bool(place >= earlier)))
    monkeypatch.setattr(ExpectedLead, 'learn', learn)
    without, others = answers(with_values(OWN, {'keypoints': 0}))
    assert not learned
    known, matches = answers(OWN)
    assert {*learned} == {False} and len(learned) < sum(bool(one.accepted) for one in matches)
    assert known.keypoints(0) is not None and not without.unreadable
    assert [without.keypoints(index) for index in range(40)] == [None] * 40
    for index in (0, 39):
        (one,), (other,) = known.pictures([index]), without.pictures([index])
        assert np.array_equal(one.packed, other.packed) and one.thumbnail == other.thumbnail
    for one, other in zip(matches[3:], others[3:], strict=True):
        assert one.accepted.reference_index == other.accepted.reference_index


@pytest.mark.parametrize(('until', 'found'), [(0, False), (12, True)])
def test_keypoints_deny_matches_if_they_never_agree_not_if_they_stop(monkeypatch, until, found):
    known = build_map(frames(60), None, OWN)
    recognizer = PlaceRecognizer(known, OWN)
    blocks, shown = KeypointWitness.blocks, []

    def blocks_at_first(*asked):
        return blocks(*asked) if len(shown) < until else 0

    monkeypatch.setattr(KeypointWitness, 'blocks', blocks_at_first)
    for frame in frames(50)[10:]:
        shown.append(recognizer.process(frame))
    assert all(match.accepted for match in shown[until + 6 :]) is found
    assert any(match.accepted for match in shown) is found


def test_a_damaged_thumbnail_is_left_out_of_the_light(walled, monkeypatch):
    read = [walled.thumbnail(index) for index in range(12)]
    read[5] = MapError('reference 5 fails its checksum')
    monkeypatch.setattr(walled, 'thumbnail', Mock(side_effect=read))
    assert difference(Light(walled, True), frames(1)[0]) < 0.06
