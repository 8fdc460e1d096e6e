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


# Accuracies of the published matrices of ten techniques.
SINGLE = {
    'alexnet': 0.685, 'amosnet': 0.847, 'ap-gem': 0.532, 'calc': 0.324, 'cohog': 0.622,
    'densevlad': 0.703, 'hog': 0.477, 'hybridnet': 0.901, 'netvlad': 0.676, 'regionvlad': 0.432,
}  # fmt: skip


def test_accuracy_on_corridor_is_as_published(shared_data, tmp_path):
    data_set = open_data_set('corridor', shared_data)
    matrices = [f'{name}=scores:{path}' for name, path in data_set.published.items()]
    longer = f'longer=scores:{data_set.published["vprbench-netvlad"]}@k10'
    plan = Plan(methods=('cohog', 'seqslam', 'convseq-k10', longer, *matrices))
    rows = evaluate([data_set], PAPER, plan, tmp_path)
    found = {one['method']: one['accuracy_matched'] for one in rows}
    assert 0.62 <= found['cohog'] <= 0.68
    assert found['convseq-k10'] >= 0.89
    # Without its wrap-around.
    assert found['seqslam'] == pytest.approx(0.5, abs=0.02)
    assert {name: found[f'vprbench-{name}'] for name in SINGLE} == pytest.approx(SINGLE, abs=1e-3)
    assert found['longer'] > SINGLE['netvlad']
