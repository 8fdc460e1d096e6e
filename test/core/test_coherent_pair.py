# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Coherent matching of a drive: less its background, and by global similarity up to half."""

from convseq_ros.config import MatchingConfig
from convseq_ros.core.encoding.regions import projected_regions
from convseq_ros.core.map.place import pack_cells, Place, unpack_cells
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.core.matcher import Matcher
from convseq_ros.core.similarity.background import Background
from convseq_ros.core.similarity.coherent import extract
from convseq_ros.core.similarity.global_similarity import global_similarity, region_blocks, widened
from convseq_ros.core.similarity.kernels.numpy_coherent import coherent_score, subtracted
from convseq_ros.core.similarity.kernels.numpy_normalization import normalized
from convseq_ros.core.types import Descriptor
import numpy as np
import pytest

EVERYTHING = np.full((32, 32), 8.0)


def drawn(seed, share=0.0):
    """Return cells that are a background, the same for all, to some share."""
    own, common = (np.random.default_rng(one).random((32, 32, 8)) ** 3 for one in (seed, 99))
    return unpack_cells(pack_cells(((1 - share) * own + share * common).astype(np.float32)))


def described(cells):
    return Descriptor(cells, np.ones(961, bool), EVERYTHING, 0.5)


def map_of(*images):
    reference_map = ReferenceMap()
    for index, cells in enumerate(images):
        reference_map.add(Place(index), pack_cells(cells))
    return reference_map


def matcher(reference_map, **settings):
    return Matcher(reference_map, MatchingConfig(kernel='numpy', **settings), 0.5)


def test_with_a_background_up_to_half_is_lost_where_images_differ_globally():
    references = [drawn(seed, 0.5) for seed in range(24)]
    query, one = described(drawn(3, 0.6)), matcher(map_of(*references))
    found = one.scores(one.extract(query), np.arange(24))
    background = Background(map_of(*references), normalized, projected_regions)
    background.update_map()
    cells = normalized(query.cells)
    own = subtracted(projected_regions(cells), background.update(projected_regions(cells)))
    for score, reference in zip(found, references, strict=True):
        other = subtracted(projected_regions(normalized(reference)), background.of_map)
        share, _ = coherent_score(extract(query, 4.0, own), other)
        (alike,) = global_similarity(
            widened(region_blocks(own), 30), region_blocks(other)[None].astype(np.float64)
        )
        assert score == pytest.approx(share * (1 + alike) / 2, abs=1e-6)
        assert 0 <= score <= 1


def test_what_all_images_have_in_common_no_longer_lifts_the_wrong_places():
    reference_map = map_of(*(drawn(seed, 0.6) for seed in range(40)))
    query, found = described(drawn(7, 0.55)), {}
    for less_background in (True, False):
        one = matcher(reference_map, subtract_background=less_background)
        scores = one.scores(one.extract(query), np.arange(40))
        assert scores.argmax() == 7
        elsewhere = np.delete(scores, 7)
        found[less_background] = (scores[7] - elsewhere.mean()) / elsewhere.std(), elsewhere.mean()
    assert found[True][0] > 3 * found[False][0]
    assert found[True][1] < found[False][1] / 3


def test_references_added_before_the_map_has_doubled_change_no_other_score():
    references = [drawn(seed, 0.5) for seed in range(40)]
    reference_map = map_of(*references[:24])
    one, query = matcher(reference_map), described(drawn(3, 0.6))
    features = one.extract(query)
    before = one.scores(features, np.arange(24))
    for index in range(24, 40):
        reference_map.add(Place(index), pack_cells(references[index]))
    one.extract(query)
    assert np.array_equal(one.scores(features, np.arange(24)), before)


def test_a_map_that_has_doubled_is_prepared_anew():
    references = [drawn(seed, 0.5) for seed in range(48)]
    reference_map, query = map_of(*references[:24]), described(drawn(3, 0.6))
    one = matcher(reference_map)
    one.scores(one.extract(query), np.arange(24))
    for index in range(24, 48):
        reference_map.add(Place(index), pack_cells(references[index]))
    found = one.scores(one.extract(query), np.arange(48))
    fresh = matcher(reference_map)
    fresh.extract(query)
    assert np.array_equal(found, fresh.scores(fresh.extract(query), np.arange(48)))
