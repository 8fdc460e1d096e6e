# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Images of another lens are seen as the map's lens would have seen them."""

from dataclasses import replace
import math
from pathlib import Path

from convseq_ros import build_map, Frame, PlaceRecognizer
from convseq_ros.app.match_picture import answer_picture
from convseq_ros.config import EncodingConfig, make_config, MatchingConfig
from convseq_ros.core.encoding.descriptor import describe, visible_cells
from convseq_ros.core.geometry.lens import pixels, rays_through
from convseq_ros.core.geometry.map_view import field_of_view, MapView
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.session_slice import joined, slices_of
from convseq_ros.core.rigid import of_roll_pitch_yaw
from convseq_ros.core.types import Camera, Reason
import cv2
import numpy as np
from pictures import walls
import pytest

LENS = Camera(64, 48, 32.0, 32.0, 31.5, 23.5)  # sees 90 degrees; its axis is the middle
BENT = 'plumb_bob', (-0.3, 0.1, 0.001, -0.002, 0.0)
ENCODING = EncodingConfig(image_size_px=256)  # 16 x 16 cells


def zoomed(scale, lens=LENS):
    return replace(lens, fx_px=lens.fx_px * scale, fy_px=lens.fy_px * scale)


def view(*cameras, grows=False, encoding=ENCODING):
    mapped = ReferenceMap(ENCODING)
    for camera in cameras:
        mapped.begin_session(0, camera)
    return MapView(mapped, encoding, grows)


def frame(camera, seed=1):
    noise = np.random.default_rng(seed).integers(0, 256, (48, 64), np.uint8)
    return Frame(0, noise, camera=camera)


def visible(of_map):
    return visible_cells(of_map.encoding.image_mask, 16)


def test_the_field_of_view_is_known_up_to_160_degrees():
    assert math.degrees(field_of_view(LENS)) == pytest.approx(90)
    assert math.degrees(field_of_view(zoomed(2))) == pytest.approx(2 * 26.565, abs=1e-3)
    assert math.isnan(field_of_view(zoomed(0.1))) and math.isnan(field_of_view(zoomed(0)))


@pytest.mark.parametrize('model', [('', ()), BENT, ('equidistant', (0.05, -0.01, 0.003, -0.001))])
def test_a_ray_meets_the_pixel_that_it_came_through(model):
    lens = replace(LENS, distortion_model=model[0], distortion=model[1])
    shares = np.array([(0.1, 0.2), (0.5, 0.5), (0.9, 0.6), (math.nan, 0.5)])
    there = pixels(lens, rays_through(lens, shares))
    assert there[:3] == pytest.approx(shares[:3] * (64, 48) - 0.5, abs=0.2)
    assert np.isnan(there[3]).all()


def test_the_image_of_a_wider_lens_is_cut():
    of_map, mount = view(LENS), of_roll_pitch_yaw((1.0, 0.0, 1.0), 0.0, 0.0, 0.0)
    wide = frame(replace(zoomed(0.5), mount=mount))
    seen = of_map.brought(wide)
    assert np.array_equal(seen.gray, wide.gray[12:36, 16:48])
    assert (seen.camera.width_px, seen.camera.height_px, seen.camera.fx_px) == (32, 24, 16.0)
    assert seen.camera.mount == mount and of_map.encoding == ENCODING
    assert of_map.problem.startswith('the camera sees 127 degrees across, that of the map 90: im')
    assert of_map.problem.endswith('fill 100% of it')


def test_the_image_of_a_narrower_lens_stands_in_the_middle_of_a_mask():
    of_map, narrow = view(LENS), frame(zoomed(2))
    seen = of_map.brought(narrow)
    assert seen.gray.shape == (96, 128) and np.array_equal(seen.gray[24:72, 32:96], narrow.gray)
    assert np.array_equal(seen.gray[0, 32:96], narrow.gray[0])  # edges are repeated
    # Of the 8 x 8 cells in the middle, those at the rim touch pixels that are not seen.
    expected = np.zeros((16, 16), bool)
    expected[5:11, 5:11] = True
    assert np.array_equal(visible(of_map), expected)
    assert of_map.problem.endswith('fill 14% of it')


def test_what_the_map_masks_stays_masked():
    mask = f'#{np.packbits(np.tri(16, dtype=bool)).tobytes().hex()}'
    masked = replace(ENCODING, image_mask=mask)
    of_map = view(LENS, encoding=masked)
    of_map.brought(frame(zoomed(1.5)))
    assert not visible(of_map)[~np.tri(16, dtype=bool)].any() and visible(of_map).any()
    of_map.brought(frame(zoomed(0.5)))
    assert of_map.encoding == masked


def test_distortion_of_both_lenses_is_taken_out():
    bent = replace(LENS, distortion_model=BENT[0], distortion=BENT[1])
    across = np.tile(np.arange(64, dtype=np.uint8) * 4, (48, 1))
    wide = Frame(0, across, camera=zoomed(0.6))
    of_map = view(bent)
    seen = of_map.brought(wide)
    height, width = seen.gray.shape
    share = np.array([(0.8, 0.3)])
    column = pixels(wide.camera, rays_through(bent, share))[0, 0]
    shown = seen.gray[int(0.3 * height), int(0.8 * width)]
    assert shown == pytest.approx(4 * column, abs=8) and abs(column - 0.6 * (51.2 - 31.5)) > 2


def test_what_a_lens_does_not_see_is_masked_although_its_distortion_folds_back():
    folding = Camera(64, 48, 40.0, 40.0, 31.5, 23.5, 'plumb_bob', (-0.15, 0.0, 0.0, 0.0))
    of_map = view(zoomed(0.43))
    of_map.brought(frame(folding))
    folded = pixels(folding, np.array([(2.3, 0.0)]))[0]
    assert 32 < folded[0] < 63  # a ray at 67 degrees, which the lens does not see
    assert visible(of_map)[8, 5:11].all() and not visible(of_map)[:, 12:].any()


@pytest.mark.parametrize(
    ('cameras', 'camera'),
    [
        ((LENS,), zoomed(1.08)),
        ((zoomed(2), LENS), zoomed(0.95)),  # as one of the map's
        ((), zoomed(2)),
        ((None,), zoomed(2)),
        ((zoomed(0),), zoomed(2)),
        ((LENS,), zoomed(0)),
        ((LENS,), None),
    ],
)
def test_frames_of_a_like_or_unknown_lens_stay_as_they_are(cameras, camera):
    of_map, shown = view(*cameras), frame(camera)
    assert of_map.brought(shown) is shown
    assert of_map.encoding is ENCODING and not of_map.problem


def test_the_most_similar_lens_of_the_map_counts():
    of_map = view(zoomed(4), zoomed(1.5), zoomed(0.5))
    assert of_map.brought(frame(LENS)).camera.fx_px == pytest.approx(32, abs=0.3)
    assert 'map 67' in of_map.problem


def test_large_images_are_reduced_to_the_view():
    large = Camera(2560, 1920, 2560.0, 2560.0, 1279.5, 959.5)
    seen = view(LENS).brought(Frame(0, np.zeros((1920, 2560), np.uint8), camera=large))
    assert max(seen.gray.shape) == 640


def test_a_growing_map_takes_frames_as_they_are_and_says_that_lenses_differ():
    of_map, shown = view(LENS, grows=True), frame(zoomed(2))
    assert of_map.brought(shown) is shown and 'begin another map' in of_map.problem


def of_sessions(*counts_and_cameras):
    made, image = ReferenceMap(ENCODING), np.zeros((64, 64), np.uint8)
    for number, (count, camera) in enumerate(counts_and_cameras):
        made.begin_session(number, camera)
        for at in range(count):
            made.add_frame(Frame(1000 * number + at, image), describe(image, ENCODING))
    return made


@pytest.mark.parametrize(
    ('camera', 'grows', 'barred', 'line'),
    [
        (LENS, False, [range(3, 5)], '2 places of the map'),
        (zoomed(2), False, [range(3), range(6, 7)], '4 places of the map'),
        (zoomed(0.5), False, [range(3, 5)], 'images are brought to its view'),
        (zoomed(0.5), True, [range(3), range(3, 5), range(6, 7)], 'begin another map'),
        (None, False, [], ''),
    ],
)
def test_places_of_another_lens_than_the_view_are_barred(camera, grows, barred, line):
    lenses = of_sessions((3, LENS), (2, zoomed(2)), (1, None), (1, LENS))
    of_map = MapView(lenses, ENCODING, grows)
    of_map.brought(frame(camera))
    assert [*of_map.barred] == barred and line in of_map.problem


CONFIG = make_config({'image_size_px': 256, 'keyframe_overlap': 1.0})


def test_a_place_is_recognised_through_a_narrower_lens_and_too_narrow_a_one_is_told():
    pictures, lens = walls(30), Camera(160, 120, 80.0, 80.0, 79.5, 59.5)
    frames = [Frame(at * 10**8, gray, camera=lens) for at, gray in enumerate(pictures)]
    reference_map = build_map(frames, config=CONFIG, links=False)

    def drive(scale):
        recognizer = PlaceRecognizer(reference_map, CONFIG)
        shown = [cv2.resize(one, None, fx=2, fy=2) for one in pictures[10:24]]
        height, width = (round(side / scale) for side in (240, 320))
        top, left = (240 - height) // 2, (320 - width) // 2
        camera = Camera(width, height, 160.0, 160.0, (width - 1) / 2, (height - 1) / 2)
        cut = [one[top : top + height, left : left + width] for one in shown]
        frames = [Frame((90 + at) * 10**8, one, camera=camera) for at, one in enumerate(cut)]
        matches = [recognizer.process(one) for one in frames]
        return matches, answer_picture(frames[-1], matches[-1], recognizer), recognizer

    matches, picture, recognizer = drive(1.6)
    assert matches[-1].accepted.reference_index == 23
    assert picture.shape[1] == 2 * 320  # as wide as the place's, for it is drawn in the same view
    assert recognizer.view.problem
    matches, _, recognizer = drive(8.0)
    assert {match.reason for match in matches} == {Reason.UNINFORMATIVE}
    assert 'too little of its view' in recognizer.view.problem


@pytest.mark.parametrize(
    'matching', [MatchingConfig(shortlist_length=4), MatchingConfig(search='exhaustive')]
)
def test_a_map_of_several_lenses_goes_by_session(matching):
    pictures = walls(30)
    wide = Camera(160, 120, 80.0, 80.0, 79.5, 59.5)
    lenses = {'wide': wide, 'narrow': zoomed(1.6, wide)}
    drives = [
        [Frame(at * 10**8, gray, camera=camera) for at, gray in enumerate(pictures)]
        for camera in lenses.values()
    ]
    maps = [build_map(drive, config=CONFIG, links=False) for drive in drives]
    reference_map = joined([part for one in maps for part in slices_of(Path('map.db'), one)])

    config = replace(CONFIG, matching=matching)

    def matched(name):
        recognizer = PlaceRecognizer(reference_map, config)
        recognizer.decider.expect(np.array([10, 40]), np.array([0.5, 0.5]), len(reference_map))
        accepted, scored = set(), set()
        for at, gray in enumerate(pictures[10:24], 90):
            match = recognizer.process(Frame(at * 10**8, gray, camera=lenses[name]))
            accepted |= {match.accepted.session} if match.accepted else set()
            scored |= {*(np.flatnonzero(np.isfinite(recognizer.pair_scores)) // 30).tolist()}
        return accepted, scored

    assert matched('wide') == ({0}, {0}) and matched('narrow') == ({1}, {1})
