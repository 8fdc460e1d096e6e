# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A map of many references: what it needs of disk and memory."""

import json
import os
import sys

from convseq_ros.config import EncodingConfig, KeyframeConfig
from convseq_ros.core.encoding.regions import global_descriptor
from convseq_ros.core.map.image_coding import thumbnail
from convseq_ros.core.map.place import pack_cells, Picture, Place
from convseq_ros.core.map.writer import MapWriter
from convseq_ros.core.types import Pose
import numpy as np
from pictures import scene
from programs import run
import pytest

pytestmark = pytest.mark.once

COUNT = 20_000
DRAWN = 50


def drawn_cells(place):
    """Return cells of fading texture, as those of an image are, at a fraction of the cost."""
    rng = np.random.default_rng(place)
    return rng.gamma(1.5, 20_000, (32, 32, 8)).astype(np.float32)


@pytest.fixture(scope='module')
def large(tmp_path_factory):
    """Write a map of places that look like one of a few, each with a bit of its own."""
    path = tmp_path_factory.mktemp('large') / 'map.db'
    rng = np.random.default_rng(0)
    cells = [pack_cells(drawn_cells(place)) for place in range(DRAWN)]
    known = [global_descriptor(drawn_cells(place)).astype(np.float32) for place in range(DRAWN)]
    thumbnails = [thumbnail(scene(place, size=(640, 480)), 128) for place in range(DRAWN)]
    with MapWriter(path, EncodingConfig(), KeyframeConfig()) as writer:
        for index in range(COUNT):
            place = Place(index * 10**8, '/camera/image_raw', Pose((index, 0, 0), (0, 0, 0, 1)))
            like = index % DRAWN
            descriptor = (known[like] + rng.normal(0, 0.01, known[like].shape)).astype(np.float16)
            writer.add(place, Picture(cells[like], thumbnails[like]), descriptor)
    return path


def test_a_reference_takes_at_most_seventeen_kilobytes_of_disk_and_its_thumbnail(large):
    thumbnails = [len(thumbnail(scene(place, size=(640, 480)), 128)) for place in range(DRAWN)]
    assert large.stat().st_size / COUNT - np.mean(thumbnails) <= 17_400


MEASURE = """
import gc, json, os, sys
from pathlib import Path
import numpy as np
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.place import Place
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.retrieval.coarse_scores import CoarseScores
from convseq_ros.core.types import Descriptor

def resident():
    gc.collect()
    pages = int(Path('/proc/self/statm').read_text().split()[1])
    return pages * os.sysconf('SC_PAGE_SIZE')

def described(cells):
    return Descriptor(cells, np.ones(1, bool), np.zeros((32, 32)), 1.0)

# What is compiled does not count.
small, packed = ReferenceMap(), np.ones((32, 32, 8), np.float16)
small.add(Place(0), packed)
CoarseScores(small).update(described(small.cells(0)))

before = resident()
reference_map = open_map(Path(sys.argv[1]))
opened = resident()
query = described(reference_map.cells(7))
coarse = CoarseScores(reference_map)
for index in range(3000):
    reference_map.cells(index * 6)
    if index % 100 == 0:
        coarse.update(query)
row = coarse.row
print(json.dumps([len(row), int(row.argmax()) % 50, opened - before, resident() - opened]))
"""


@pytest.mark.skipif(not os.path.exists('/proc/self/statm'), reason='needs /proc')
def test_a_map_takes_little_more_memory_than_its_global_descriptors(large):
    # What is freed goes back to the system at once, however memory was used before.
    malloc = {'MALLOC_TRIM_THRESHOLD_': '1000000', 'MALLOC_MMAP_THRESHOLD_': '200000'}
    answer = run(sys.executable, '-c', MEASURE, large, env=os.environ | malloc, timeout=180)
    assert not answer.returncode, answer.stderr
    count, like, opened, used = json.loads(answer.stdout)
    assert (count, like) == (COUNT, 7)
    assert 500 * COUNT < opened < 1100 * COUNT
    assert used < 6e6
