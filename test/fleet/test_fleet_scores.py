# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Shards name the places that one map of all names, whatever they know of the drive."""

from pathlib import Path
from types import SimpleNamespace

from convseq_ros.config import EncodingConfig
from convseq_ros.core.encoding.regions import global_descriptor
from convseq_ros.core.map.place import Place, Places
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.sequence.centred import sums_of, usual_of
from convseq_ros.core.sequence.coarse_scores import CoarseScores
from convseq_ros.fleet import shard
from convseq_ros.fleet.fleet import FleetScores
from convseq_ros.fleet.shard import merged, Shard
import numpy as np
import pytest

ENCODING = EncodingConfig(image_size_px=64)
SIZES = (1,), (30, 2), (200,), (7, 40)  # of the sessions of each map
STARTS = 0, 1, 33, 233


def map_of(sizes, descriptors):
    places = Places(len(descriptors[0]))
    sessions = np.repeat(np.arange(len(sizes)), sizes)
    for session, descriptor in zip(sessions, descriptors, strict=True):
        places.append(Place(0, session=int(session)), descriptor)
    return ReferenceMap(ENCODING, places)


@pytest.fixture
def world(monkeypatch):
    """Return one map, and a way to make the shards that it is of; some places are alike."""
    rng = np.random.default_rng(0)
    shape, count = ReferenceMap(ENCODING).cell_shape, sum(map(sum, SIZES))
    cells = rng.random((40, *shape), np.float32)
    known = np.array([global_descriptor(one) for one in cells], np.float16)
    descriptors = known[rng.integers(0, 40, count)]
    ends = *STARTS[1:], count
    maps = [
        map_of(sizes, descriptors[start:end])
        for sizes, start, end in zip(SIZES, STARTS, ends, strict=True)
    ]
    whole = map_of([size for sizes in SIZES for size in sizes], descriptors)
    opened = {Path(str(number)): one for number, one in enumerate(maps)}
    monkeypatch.setattr(shard, 'open_map', opened.__getitem__)
    queries = [SimpleNamespace(cells=cells[at], vector=None) for at in rng.integers(0, 40, 600)]
    return whole, lambda number: Shard(Path(str(number))), queries


class Asked:
    """All shards of a fleet."""

    def __init__(self, new):
        self.shards, self.new, self.questions = [*map(new, range(len(SIZES)))], new, 0

    def __call__(self, question):
        self.questions += 1
        told = zip(self.shards, STARTS, strict=True)
        return merged([one.answer(question, start) for one, start in told], question)

    def die(self, number):
        self.shards[number] = self.new(number)


@pytest.mark.parametrize('both', [False, True])
def test_every_frame_has_the_places_of_one_map(world, both):
    whole, new, queries = world
    descriptors = whole.global_descriptors
    asked, one = Asked(new), CoarseScores(whole, both)
    usual = usual_of(sums_of(descriptors), len(descriptors))
    fleet = FleetScores(asked, usual, both, 0)
    died = {2: 0, 20: 1, 21: 3, 590: 2}
    for number, query in enumerate(queries):
        if number == 30:
            one.reset()
            fleet.reset()
        if number in died:
            asked.die(died[number])
        one.update(query, len(whole))
        fleet.update(query, len(whole))
        if number % 7 == 6:  # not every frame is asked about
            continue
        passed = (range(-3, 4), range(30, 60), range(270, 300))
        for wanted in ((12, 5), (8, 0, passed), (0, 300)):
            assert fleet.best(*wanted).tolist() == one.best(*wanted).tolist()
    assert asked.shards[2]._known[0].track.sums.tolist() == one._track.sums[33:233].tolist()


def test_only_who_lacks_frames_is_told_them(world):
    whole, new, queries = world
    usual = usual_of(sums_of(whole.global_descriptors), len(whole))
    asked = Asked(new)
    cameras = [FleetScores(asked, usual, False, number) for number in range(2)]
    for query in queries[:10]:
        for camera in cameras:
            camera.update(query, len(whole))
            camera.best(10, 3)
    assert asked.questions == 20
    asked.die(1)
    cameras[0].best(10, 3)
    assert asked.questions == 22
