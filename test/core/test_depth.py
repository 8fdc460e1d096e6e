# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A registered depth image gives metres where odometry does not; a bad one takes nothing away."""

from dataclasses import replace
import sqlite3

from convseq_ros.config import Config, EVERY_FRAME
from convseq_ros.core.encoding.view import upright
from convseq_ros.core.map.edit import joined, slices_of, write_new
from convseq_ros.core.map.kept_image import packed_depths, unpacked_depths
from convseq_ros.core.map.reader import MapReader, open_map
from convseq_ros.core.map_builder import build_map
from convseq_ros.simulation.drive import Drive
from convseq_ros.simulation.street import Street
from drives import shots_of
import numpy as np
import pytest

from test.core.measured_pose import measured, off, SIZE

pytestmark = pytest.mark.once

EVERY = Config(keyframes=EVERY_FRAME)


@pytest.fixture(scope='module')
def street():
    """Return frames with depth of a map, and of a drive in the evening, further left."""
    way = Street(120.0, 5)
    there = Drive(num_frames=14, has_depth=True, **SIZE)
    here = Drive(num_frames=10, start_m=2.4, lane_offset_m=-0.7, light='evening', seed=1, **SIZE)
    return [[shot.frame for shot in shots_of(way, one)] for one in (there, here)]


def blind(frames, change=lambda depth_m: depth_m):
    """Return frames without odometry, with other depth images."""
    return [replace(one, pose=None, depth_m=change(one.depth_m)) for one in frames]


@pytest.mark.parametrize('index', [9, 10, 11])
def test_depth_tells_metres_without_odometry(street, index):
    query = street[1][8]
    pose = measured(build_map(blind(street[0]), None, EVERY), query, index)
    assert off(pose, query, street[0][index])[0] < 0.4
    assert 0.02 < pose.position_sigma_m < 0.6


@pytest.mark.parametrize(
    'change',
    [
        lambda _: None,
        lambda depth_m: np.full_like(depth_m, np.nan),
        lambda depth_m: np.full_like(depth_m, np.inf),
        lambda depth_m: -depth_m,
        np.zeros_like,
        lambda depth_m: depth_m[:100],
        lambda depth_m: depth_m[:0],
        lambda depth_m: depth_m * np.float32(1e6),
    ],
)
def test_what_is_no_depth_tells_no_metres(street, change):
    told = build_map(blind(street[0], change), None, EVERY)
    assert told.pictures([9], True)[0].depths is None
    assert measured(told, street[1][8], 9).position_m is None


def test_depths_are_those_of_the_middles_of_regions():
    rows, columns = np.indices((320, 640), np.float32)
    depth_m = 1 + rows / 10 + columns / 100
    depths = unpacked_depths(packed_depths(depth_m, (320, 640), 32), 32).reshape(30, 30)
    # The middle cell of the first region is the second cell, rows 10 to 19, columns 20 to 39.
    assert depths[0, 0] == pytest.approx(1 + 1.45 + 0.295, abs=0.06)
    assert depths[29, 29] == pytest.approx(1 + 30.45 + 6.095, abs=0.1)
    with pytest.raises(ValueError, match='regions'):
        unpacked_depths(b'\0' * 10, 32)


def test_a_camera_on_its_side_has_its_depth_turned_with_it(street):
    frame = street[0][0]
    config = replace(Config().encoding, image_rotation_deg=90)
    turned = upright(frame, config)
    assert np.array_equal(turned.depth_m, np.rot90(frame.depth_m))


def test_a_file_keeps_depths_and_one_without_is_as_before(street, tmp_path):
    path, plain = tmp_path / 'map.sqlite', tmp_path / 'plain.sqlite'
    held = build_map(blind(street[0]), path, EVERY)
    build_map(blind(street[0], lambda _: None), plain, EVERY)
    merged = tmp_path / 'merged.sqlite'
    write_new(joined([*slices_of(path), *slices_of(plain)]), merged)
    count = len(street[0])
    for file, known in ((path, count), (plain, 0), (merged, count)):
        assert MapReader(file).about()['depths'] == known
    opened = open_map(merged)
    kept = [one.depths for one in opened.pictures(range(2 * count), True)]
    assert kept[:count] == [one.depths for one in held.pictures(range(count), True)]
    assert kept[count:] == [None] * count
    query = street[1][8]
    one, other = measured(held, query, 9), measured(open_map(path), query, 9)
    assert one.position_m == other.position_m


def test_a_damaged_depth_is_counted(street, tmp_path):
    path = tmp_path / 'map.sqlite'
    build_map(blind(street[0]), path, EVERY)
    with sqlite3.connect(path) as database:
        database.execute("UPDATE depths SET metres = x'00' WHERE reference_index = 9")
    database.close()
    opened = open_map(path)
    assert measured(opened, street[1][8], 9).position_m is None
    assert opened.images.unreadable and 'reference 9 fails its checksum' in opened.images.problem
