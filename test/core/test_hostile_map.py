# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps that declare what they do not hold."""

import sqlite3

from convseq_ros.config import EncodingConfig
from convseq_ros.core.map.place import Place
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.map.writer import save_map
from convseq_ros.errors import MapError
import numpy as np
import pytest


@pytest.fixture
def map_path(tmp_path):
    reference_map = ReferenceMap(EncodingConfig(image_size_px=64))
    for index in range(5):
        cells = np.full((4, 4, 8), index + 1, np.float16)
        reference_map.add(Place(index, 'drawn'), cells, b'')
    save_map(reference_map, tmp_path / 'map.db')
    return tmp_path / 'map.db'


@pytest.mark.parametrize('last', [10**8, 10**10, 2**62])
def test_a_last_index_far_away_takes_no_memory(map_path, last):
    with sqlite3.connect(map_path) as database:
        for table in ('places', 'pictures'):
            database.execute(
                f'UPDATE {table} SET reference_index = {last} WHERE reference_index = 4'
            )
    with pytest.raises(MapError, match='damaged map'):
        open_map(map_path)


def test_settings_that_are_nested_too_deeply_are_damage(map_path):
    with sqlite3.connect(map_path) as database:
        database.execute('UPDATE about SET value = ? WHERE name = ?', ('[' * 100_000, 'encoding'))
    with pytest.raises(MapError, match='damaged map'):
        open_map(map_path)
