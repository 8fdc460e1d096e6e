# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The bench on real sets, against what others published, where these are at hand."""

from convseq_ros.config import Config
from convseq_ros.evaluation.bench import evaluate, Plan
from convseq_ros.evaluation.data_set import open_data_set
from convseq_ros.evaluation.recognition import with_known
import pytest

# The released script resizes by OpenCV's INTER_LINEAR.
PAPER = with_known(Config(), {'matching': 'regional', 'search': 'exhaustive', 'resize': 'linear'})


@pytest.fixture(scope='module')
def corridor(shared_data, kept, tmp_path_factory):
    """Return the accuracy over matched queries of every method on corridor."""
    data_set = open_data_set('corridor', shared_data)
    output = tmp_path_factory.mktemp('results')
    plan = Plan(methods=('cohog', 'seqslam', 'convseq-k10', 'published'))
    rows = evaluate([data_set], PAPER, plan, output, kept)
    return {one['method']: one['accuracy_matched'] for one in rows}


def test_accuracy_on_corridor_is_as_published(corridor):
    assert 0.62 <= corridor['cohog'] <= 0.68
    assert corridor['convseq-k10'] >= 0.89


def test_the_published_matrices_of_ten_techniques_are_in_the_table(corridor):
    single = {
        'alexnet': 0.685,
        'amosnet': 0.847,
        'ap-gem': 0.532,
        'calc': 0.324,
        'cohog': 0.622,
        'densevlad': 0.703,
        'hog': 0.477,
        'hybridnet': 0.901,
        'netvlad': 0.676,
        'regionvlad': 0.432,
    }
    for name, accuracy in single.items():
        assert corridor[f'vprbench-{name}'] == pytest.approx(accuracy, abs=1e-3)
        assert corridor[f'vprbench-{name}-k10'] > corridor[f'vprbench-{name}']
        assert corridor[f'vprbench-{name}-dynamic'] > corridor[f'vprbench-{name}']


def test_seqslam_without_its_wrap_around_finds_half_of_corridor(corridor):
    assert corridor['seqslam'] == pytest.approx(0.5, abs=0.02)
