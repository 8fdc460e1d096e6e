# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The six names of the package: what the README shows works, and nothing heavy loads before."""

from dataclasses import replace
import sys

import convseq_ros
from convseq_ros import build_map, Config, Frame, open_map, PlaceRecognizer
from convseq_ros.config import EncodingConfig
from convseq_ros.core.matcher import DescriptorMatcher, Features
import numpy as np
from programs import run
import pytest

SECOND = 1_000_000_000
SMALL = Config(encoding=EncodingConfig(image_size_px=128))


def drive(seed: int) -> list[Frame]:
    """Return frames of places that have nothing in common, with noise by a seed."""
    places = np.random.default_rng(0).integers(0, 200, (30, 96, 128), np.uint8)
    noise = np.random.default_rng(seed).integers(0, 30, places.shape, np.uint8)
    return [Frame(index * SECOND, gray) for index, gray in enumerate(places + noise)]


class Correlation(DescriptorMatcher):
    """The pair score that docs/tutorials/own_network.md shows."""

    places = None

    def extract(self, descriptor):
        return Features(descriptor.cells, descriptor.cells)

    def scores_of(self, asked):
        return [np.array([self.score(one.exact, at) for at in places]) for one, places in asked]

    def score(self, query, index):
        return max(0.0, np.corrcoef(query.ravel(), self.places.cells(index).ravel())[0, 1])


def test_a_pair_score_of_ones_own_reads_the_places_of_a_map_file(tmp_path):
    build_map(drive(1), tmp_path / 'map.db', SMALL)
    street = Correlation.places = open_map(tmp_path / 'map.db')
    config = replace(SMALL, acceptance=replace(SMALL.acceptance, acceptance_rule='margin'))
    recognizer = PlaceRecognizer(street, config, matcher=Correlation(street))
    last = [recognizer.process(frame) for frame in drive(2)][-1].accepted
    assert last is not None and last.reference_index == 29


def test_the_six_names_are_all_that_is_public():
    assert sorted(convseq_ros.__all__) == sorted(
        ['Config', 'Frame', 'Match', 'PlaceRecognizer', 'build_map', 'open_map']
    )
    assert set(convseq_ros.__all__) <= set(dir(convseq_ros))
    assert all(name in convseq_ros.__doc__ for name in convseq_ros.__all__)
    with pytest.raises(AttributeError, match='no attribute'):
        _ = convseq_ros.nothing_of_the_kind


def test_importing_the_package_loads_nothing_heavy():
    code = 'import sys, convseq_ros; print({"numpy", "cv2", "yaml"} & sys.modules.keys())'
    result = run(sys.executable, '-c', code)
    assert result.stdout.strip() == 'set()', result.stderr
