# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's pair score."""

from convseq_ros.config import MatchingConfig
from convseq_ros.core.encoding.regions import paper_regions
from convseq_ros.core.map.place import pack_cells, Place
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.matcher import Matcher
from convseq_ros.core.similarity.kernels.numpy_regional import pair_scores
from convseq_ros.core.similarity.paper_similarity import PaperSimilarity
from convseq_ros.core.types import Descriptor
import numpy as np
import pytest

NUMPY = MatchingConfig(matching='regional', kernel='numpy')


def drawn(seed, salient=None):
    rng = np.random.default_rng(seed)
    mask = np.ones(961, bool) if salient is None else salient
    return Descriptor(rng.random((32, 32, 8), np.float32), mask, np.full((32, 32), 5.0), 0.6)


def test_a_region_joins_its_four_cells_row_by_row_at_unit_length():
    cells = np.zeros((2, 2, 1), np.float32)
    cells[0, 1], cells[1, 0] = 3, 4
    assert paper_regions(cells).tolist() == [[0, pytest.approx(0.6), pytest.approx(0.8), 0]]


def test_a_region_without_gradient_stays_zero():
    assert not paper_regions(np.zeros((3, 3, 8), np.float32)).any()


def test_hand_worked_pair_is_the_mean_of_the_best_similarities():
    query = np.zeros((2, 3, 1), np.float32)
    query[0, :, 0] = [1, 0, 1]
    reference = np.zeros((2, 2, 1), np.float32)
    reference[0, :, 0] = [3, 4]
    described = Descriptor(query, np.array([True, True]), np.zeros((2, 3)), 0.5)
    assert pair_scores(described, [paper_regions(reference)])[0] == pytest.approx((0.6 + 0.8) / 2)


def test_only_salient_regions_of_the_query_count():
    query = np.zeros((2, 3, 1), np.float32)
    query[0, :, 0] = [1, 0, 1]
    reference = np.zeros((2, 2, 1), np.float32)
    reference[0, :, 0] = [3, 4]
    described = Descriptor(query, np.array([False, True]), np.zeros((2, 3)), 0.5)
    assert pair_scores(described, [paper_regions(reference)])[0] == pytest.approx(0.8)


def test_an_image_is_perfectly_similar_to_itself():
    assert PaperSimilarity()(drawn(0), drawn(0)) == pytest.approx(1, abs=1e-6)


def test_adding_references_changes_no_other_score():
    others = [paper_regions(drawn(seed).cells) for seed in range(4)]
    assert (pair_scores(drawn(9), others)[:2] == pair_scores(drawn(9), others[:2])).all()


def test_scores_lie_between_zero_and_one_and_follow_the_order_of_references():
    others = [paper_regions(drawn(seed).cells) for seed in range(4)]
    scores = pair_scores(drawn(9), others)
    assert (scores >= 0).all() and (scores <= 1).all()
    assert (pair_scores(drawn(9), others[::-1]) == scores[::-1]).all()


def test_the_matcher_scores_what_it_is_asked_for_and_nothing_that_shows_nothing():
    reference_map = ReferenceMap()
    for cells in (drawn(0).cells, np.zeros((32, 32, 8), np.float32), drawn(1).cells):
        reference_map.add(Place(0), pack_cells(cells))
    matcher = Matcher(reference_map, NUMPY, 0.5)
    query = matcher.extract(drawn(9))
    scores = matcher.scores(query, np.array([1, 2]))
    assert np.isnan(scores[0]) and scores[1] == matcher.scores(query, np.array([2]))[0]
    assert matcher.shift(query, 2) is None


def test_a_query_without_salient_region_shows_nothing():
    nothing = drawn(0, np.zeros(961, bool))
    assert Matcher(ReferenceMap(), NUMPY, 0.5).extract(nothing) is None
