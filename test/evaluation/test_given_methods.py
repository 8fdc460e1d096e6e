# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What users bring: score matrices, descriptors, ONNX models."""

from convseq_ros.errors import ConvseqError
from convseq_ros.evaluation.bench import evaluate, Plan
from convseq_ros.evaluation.data_set import open_data_set
from descriptor_models import made
import numpy as np
import pytest


@pytest.fixture
def accuracy(street, quick, tmp_path):
    """Return what a method reaches on the drawn street."""

    def measured(method):
        data_set = open_data_set(str(street.file))
        plan = Plan(methods=(method,))
        (summary,) = evaluate([data_set], quick, plan, tmp_path / 'out')
        return summary['accuracy_all']

    return measured


def test_distances_can_be_given_instead_of_scores(accuracy, tmp_path):
    np.save(tmp_path / 'net.npy', 1 - np.eye(24))
    assert accuracy(f'scores:{tmp_path}/net.npy') < 0.2
    assert accuracy(f'scores:{tmp_path}/net.npy+lower_is_better=true') == 1
    with pytest.raises(ConvseqError, match="lower_is_better is true or false, not 'yes'"):
        accuracy(f'scores:{tmp_path}/net.npy+lower_is_better=yes')


def test_descriptors_are_compared_by_cosine(accuracy, tmp_path):
    rows = np.random.default_rng(0).normal(size=(24, 8))
    np.save(tmp_path / 'q.npy', rows)
    np.save(tmp_path / 'r.npy', 3 * rows)
    np.save(tmp_path / 'short.npy', rows[:, :5])
    assert accuracy(f'descriptors:{tmp_path}/q.npy,{tmp_path}/r.npy') == 1
    with pytest.raises(ConvseqError, match='descriptors of 8 and 5 numbers cannot be compared'):
        accuracy(f'descriptors:{tmp_path}/q.npy,{tmp_path}/short.npy')
    with pytest.raises(ConvseqError, match=r'expected descriptors:QUERY.npy,REFERENCE.npy'):
        accuracy(f'descriptors:{tmp_path}/q.npy')


def test_an_onnx_model_describes_the_images(accuracy, tmp_path):
    onnx = pytest.importorskip('onnx', reason='needs onnx to make a model')
    pytest.importorskip('onnxruntime', reason='needs onnxruntime to run a model')
    helper, kind = onnx.helper, onnx.TensorProto.FLOAT
    graph = helper.make_graph(
        [helper.make_node('Flatten', ['image'], ['descriptor'])],
        'pixels',
        [helper.make_tensor_value_info('image', kind, (1, 1, 'height', 'width'))],
        [helper.make_tensor_value_info('descriptor', kind, None)],
    )
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid('', 13)], ir_version=8)
    onnx.save(made, str(tmp_path / 'm.onnx'))
    assert accuracy(f'onnx:{tmp_path}/m.onnx+size=32x32+mean=0.5+scale=0.25') == 1
    with pytest.raises(ConvseqError, match='takes images of any size; say'):
        accuracy(f'onnx:{tmp_path}/m.onnx')
    with pytest.raises(ConvseqError, match='could not convert string to float'):
        accuracy(f'onnx:{tmp_path}/m.onnx+size=32x32+mean=half')


def test_a_model_is_a_first_stage_of_the_recogniser(accuracy, tmp_path):
    net = made(tmp_path / 'net.onnx', 'random', 32, 64)
    for more in ('', '+matching=descriptor'):
        assert accuracy(f'convseq+descriptor_model={net}{more}') > 0.6
    made(net, 'hog', 32, 64)
    assert accuracy(f'convseq+descriptor_model={net}') > 0.6  # not what was kept of the other one


def test_what_robots_run_decides_by_itself(accuracy):
    assert accuracy('orb-bow') is not None
    with pytest.raises(ConvseqError, match='alpha is not a number'):
        accuracy('sift-vlad+alpha=low')
