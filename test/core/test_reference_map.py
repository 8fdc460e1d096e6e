# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The reference map in memory: what was added is there, whole, for every thread; thumbnails."""

from itertools import pairwise
from threading import Thread
import tracemalloc

from convseq_ros.config import Config
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.map import arrays
from convseq_ros.core.map.arrays import GrowingArray
from convseq_ros.core.map.image_coding import decode_image, decode_jpeg, encode_image, thumbnail
from convseq_ros.core.map.online import FollowedMap, OnlineMap
from convseq_ros.core.map.place import pack_cells, Picture, Place
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Frame, Pose
import cv2
import numpy as np
import pytest

from bench.torture.maps import cells, drawn, ENCODING

POSE = Pose((1.5, -2.0, 0.25), (0.0, 0.0, 0.6, 0.8))


@pytest.mark.parametrize('index', [-1, 1])
def test_a_place_that_is_not_there_is_an_index_error(index):
    reference_map = drawn(1)
    with pytest.raises(IndexError, match='of 1'):
        reference_map.cells(index)
    with pytest.raises(IndexError, match='of 1'):
        reference_map.packed_of([0, index])


def test_descriptors_of_a_growing_map_leave_no_holes_in_the_heap():
    array = GrowingArray(np.empty((0, 8)))
    tracemalloc.start()
    try:
        for number in range(10_000):
            array.extend([np.full(8, number)])
        ours = tracemalloc.Filter(True, arrays.__file__)
        held = tracemalloc.take_snapshot().filter_traces([ours]).traces
    finally:
        tracemalloc.stop()
    # The heap has none of them.
    assert sum(one.size for one in held) < 50_000 < array.view.nbytes
    assert array.view[:, 3].tolist() == [*range(10_000)]


def test_readers_of_a_growing_map_find_complete_places():
    reference_map, problems = ReferenceMap(ENCODING), []
    known = np.zeros(reference_map.global_descriptors.shape[1])

    def read():
        while len(reference_map) < 3000:
            last = len(reference_map) - 1
            if last < 0:
                continue
            descriptors = reference_map.global_descriptors
            good = (
                reference_map.places[last].stamp_ns == last
                and reference_map.thumbnail(last) == b'%d' % last
                and len(descriptors) > last
                and descriptors[last, 0] == last % 2048
            )
            if not good:
                problems.append(last)

    readers = [Thread(target=read) for _ in range(3)]
    for reader in readers:
        reader.start()
    packed = cells(0)
    for index in range(3000):
        known[0] = index % 2048
        reference_map.add(Place(index, pose=POSE), packed, b'%d' % index, known)
        if index % 700 == 699:
            reference_map.evict(0, lambda indices, _=False: [Picture(packed, b'')] * len(indices))
    for reader in readers:
        reader.join()
    assert not problems


@pytest.mark.parametrize(
    ('shape', 'small'),
    [
        ((480, 640), (96, 128)),
        ((640, 160), (512, 128)),
        ((1, 5000), (1, 128)),
        ((5000, 1), (512, 1)),
        ((60_000, 2), (512, 1)),
        ((1, 1), (128, 128)),
    ],
)
def test_a_thumbnail_has_the_given_width_and_a_bounded_height(shape, small):
    jpeg = np.frombuffer(thumbnail(np.full(shape, 90, np.uint8), 128), np.uint8)
    assert cv2.imdecode(jpeg, cv2.IMREAD_GRAYSCALE).shape == small


def test_a_jpeg_larger_than_a_thumbnail_is_not_decoded(monkeypatch):
    jpeg = thumbnail(np.full((480, 640), 90, np.uint8), 640)
    assert decode_jpeg(jpeg).shape == (480, 640)
    assert decode_jpeg(thumbnail(np.full((5000, 2), 90, np.uint8), 640)).shape[0] == 2560
    assert decode_jpeg(b'') is None and decode_jpeg(b'no picture') is None
    monkeypatch.setattr(cv2, 'imdecode', lambda *_: pytest.fail('it was decoded'))
    sides = jpeg.index(b'\xff\xc0') + 5  # of the header
    assert decode_jpeg(jpeg[:sides] + 2 * (30_000).to_bytes(2) + jpeg[sides + 4 :]) is None


def test_a_copy_of_the_first_places_does_not_grow_with_them(a_map):
    places = a_map(2, 3).places
    copy = places.first(4)
    assert [*copy] == places[:4] and copy.bounds.starts.tolist() == [0, 2]
    assert np.array_equal(copy.descriptors.view, places.descriptors.view[:4])
    places.append(places[0], places.descriptors.view[0])
    assert len(copy) == 4


SECOND = 10**9
GRAY = np.random.default_rng(0).integers(0, 256, (48, 64), np.uint8)
DESCRIPTOR = describe(GRAY, ENCODING)
VIEWS = np.eye(2, dtype=np.float32)  # glances far from each other


def follow(mapping, before, passed):
    """Pass scenes until there were so many; `before` were passed already."""
    for number in range(before + 1, passed + 1) or [passed]:
        mapping.follow(VIEWS[number % 2], 100 * SECOND)


def grown(passed, earlier=0):
    """Add a place each time so many scenes were passed; return the map and what was usable."""
    reference_map = drawn(earlier)
    mapping, usable = OnlineMap(reference_map, Config()), []
    for before, scenes in pairwise([0, *passed]):
        follow(mapping, before, scenes)
        usable.append(mapping.usable)
        mapping.add(Frame(SECOND, GRAY, 'camera'), DESCRIPTOR)
    return mapping, reference_map, usable


@pytest.mark.parametrize(
    ('passed', 'earlier', 'expected'),
    [
        (range(1, 26), 0, [0] * 21 + [1, 2, 3, 4]),
        (range(1, 24), 7, [7] * 21 + [8, 9]),  # those of an earlier session at once
        # Scenes without a place are counted, and places in between are not.
        ([1, 2, 2, 2, 3, 22, 23], 0, [0, 0, 0, 0, 0, 1, 4]),
    ],
)
def test_places_become_usable_once_more_than_20_scenes_were_passed(passed, earlier, expected):
    mapping, reference_map, usable = grown(passed, earlier)
    assert usable == expected and mapping.session_start == earlier
    assert len(reference_map) == earlier + len(passed)
    follow(mapping, passed[-1], passed[-1] + 1)  # its frame is not stored
    assert mapping.usable == expected[-1] + 1


def test_a_camera_that_follows_another_takes_over_its_session_with_the_next_keyframe():
    leader, reference_map, _ = grown(range(1, 5))
    followed = FollowedMap(reference_map, leader)
    leader.reset()
    assert followed.session_start == 0
    followed.follow(None, 0)
    assert (followed.session_start, followed.drive_start) == (4, 4)


def test_a_new_session_begins_at_the_end_of_the_map_and_the_last_places_stay_recent():
    mapping, reference_map, _ = grown(range(1, 5))
    follow(mapping, 4, 5)
    assert mapping.usable == 0
    mapping.reset()
    assert (mapping.session_start, mapping.usable) == (4, 0)
    follow(mapping, 5, 6)
    mapping.add(Frame(0, GRAY), DESCRIPTOR)
    before = 6
    for scenes, usable in ((21, 0), (22, 1), (26, 4), (27, 5)):
        follow(mapping, before, scenes)
        before = scenes
        assert mapping.usable == usable
    assert len(reference_map) == 5


def test_a_frozen_map_adds_no_place_and_still_counts_scenes():
    mapping, reference_map, _ = grown(range(1, 24))
    mapping.freeze()
    follow(mapping, 23, 24)
    mapping.add(Frame(SECOND, GRAY), DESCRIPTOR)
    assert len(reference_map) == 23 and mapping.usable == 3


def test_an_image_is_kept_in_memory_before_it_is_in_a_file():
    whole, packed = ReferenceMap(ENCODING), pack_cells(DESCRIPTOR.cells)
    whole.add(Place(0), packed)
    assert whole.image(0, 1.0) is None
    whole.add(Place(1), packed, image=encode_image(GRAY, 64))
    assert whole.image(1, 1.0).shape == GRAY.shape and whole.image(0, 1.0) is None


@pytest.mark.parametrize(
    ('shape', 'kept'),
    [((30, 40), (15, 20)), ((40, 10), (20, 5)), ((20, 8), (20, 8)), ((1, 90), (1, 20))],
)
def test_the_longer_side_of_a_kept_image_is_reduced_and_none_is_enlarged(shape, kept):
    jpeg = encode_image(np.zeros(shape, np.uint8), 20)
    assert decode_image(jpeg, 1.0).shape == kept
