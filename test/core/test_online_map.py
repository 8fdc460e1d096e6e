# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A map that grows from the robot's own past."""

from convseq_ros.config import Config, EncodingConfig, OnlineConfig
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.map.online import OnlineMap
from convseq_ros.core.map.place import pack_cells, Place
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.types import Frame, Pose
import numpy as np

SECOND = 10**9
SMALL = EncodingConfig(image_size_px=64)
GRAY = np.random.default_rng(0).integers(0, 256, (48, 64), np.uint8)
DESCRIPTOR = describe(GRAY, SMALL)


def at(x):
    return Pose((float(x), 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def grown(online, seconds, poses=None, earlier=0):
    """Drive for some seconds; return the online map and how much was usable at each."""
    reference_map = ReferenceMap(SMALL)
    for index in range(earlier):
        reference_map.add(Place(index), pack_cells(DESCRIPTOR.cells))
    mapping = OnlineMap(reference_map, Config(online=online))
    usable = []
    for second in range(seconds):
        pose = poses[second] if poses else None
        usable.append(mapping.update(second * SECOND, pose))
        mapping.add(Frame(second * SECOND, GRAY, 'camera', pose), DESCRIPTOR)
    return mapping, reference_map, usable


def test_places_become_usable_when_they_are_old_enough():
    _, reference_map, usable = grown(OnlineConfig(exclusion_s=5.0), 10)
    assert len(reference_map) == 10
    assert usable == [0, 0, 0, 0, 0, 1, 2, 3, 4, 5]


def test_places_of_an_earlier_session_are_usable_at_once():
    mapping, _, usable = grown(OnlineConfig(exclusion_s=3.0), 5, earlier=7)
    assert mapping.session_start == 7
    assert usable == [7, 7, 7, 8, 9]


def test_by_odometry_places_must_also_be_far_behind_on_the_way():
    online = OnlineConfig(exclusion_s=2.0, exclusion_m=10.0)
    there_and_back = [at(4 * min(second, 8 - second)) for second in range(9)]
    assert grown(online, 9, there_and_back)[2] == [0, 0, 0, 1, 2, 3, 4, 5, 6]
    standing = [at(0)] * 9
    assert grown(online, 9, standing)[2] == [0] * 9


def test_a_new_session_makes_all_of_the_map_the_past():
    mapping, reference_map, _ = grown(OnlineConfig(exclusion_s=5.0), 4)
    assert mapping.update(4 * SECOND, None) == 0
    mapping.reset()
    assert mapping.session_start == mapping.update(0, None) == 4
    mapping.add(Frame(0, GRAY), DESCRIPTOR)
    assert [mapping.update(second * SECOND, None) for second in (1, 5)] == [4, 5]
    assert len(reference_map) == 5
