# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Words of given folders, and the direct index, on a drawn street."""

from functools import partial

from convseq_ros.config import EncodingConfig
from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.evaluation.data_set import open_data_set
from convseq_ros.evaluation.material import open_material
from convseq_ros.evaluation.peers import peer_scores
import pytest


@pytest.fixture
def scores(street, tmp_path):
    """Return a function of options that gives the scores of bags of words, of both folders."""
    material = open_material(open_data_set(str(street.file)), EncodingConfig())
    folders = f'{tmp_path / "query"},{tmp_path / "reference"}'
    return partial(peer_scores, material, 'orb-bow', 0.3, folders, ReadingConfig(), 160)


def test_the_direct_index_at_the_root_is_none_and_at_the_words_finds_fewer(scores):
    def inliers(direct):
        pairs = scores(levels=3, direct=direct)
        return [one.inliers for one in pairs.detect(pairs.scores, consistent=1)]

    everywhere, at_root, at_words = inliers(None), inliers(3), inliers(0)
    assert sum(everywhere) > 0 and at_root == everywhere
    assert 0 < sum(at_words) < sum(everywhere)
