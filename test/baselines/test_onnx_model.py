# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Descriptors from ONNX models, small ones that are made here."""

from convseq_ros.baselines.onnx_model import OnnxModel
from convseq_ros.errors import SourceError
import numpy as np
import pytest

onnx = pytest.importorskip('onnx', reason='needs onnx to make a model')
pytest.importorskip('onnxruntime', reason='needs onnxruntime to run a model')


def model(path, shape=(1, 3, 8, 8), kind=onnx.TensorProto.FLOAT, operator='AveragePool'):
    """Write a model whose descriptor are the means of 4 x 4 px, channel by channel."""
    helper = onnx.helper
    options = {'kernel_shape': [4, 4], 'strides': [4, 4]} if operator == 'AveragePool' else {}
    graph = helper.make_graph(
        [helper.make_node(operator, ['image'], ['descriptor'], **options)],
        'small',
        [helper.make_tensor_value_info('image', kind, shape)],
        [helper.make_tensor_value_info('descriptor', kind, None)],
    )
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid('', 13)], ir_version=8)
    onnx.save(made, str(path))
    return path


def test_a_descriptor_is_what_the_model_makes_of_the_normalised_image(tmp_path):
    image = np.zeros((8, 8), np.uint8)
    image[:4] = 255
    found = OnnxModel(model(tmp_path / 'm.onnx'), mean=(0.5,), std=(0.25,)).describe(image)
    assert found.tolist() == [2, 2, -2, -2] * 3


def test_a_grey_model_gets_one_channel(tmp_path):
    path = model(tmp_path / 'm.onnx', (1, 1, 8, 8))
    found = OnnxModel(path, mean=(0.0,), std=(1.0,)).describe(np.full((20, 30), 255, np.uint8))
    assert found.tolist() == [1, 1, 1, 1]
    assert OnnxModel(path).describe(np.zeros((8, 8), np.uint8)).shape == (4,)


def test_a_model_for_any_size_needs_one(tmp_path):
    path = model(tmp_path / 'm.onnx', ('n', 3, 'height', 'width'))
    with pytest.raises(SourceError, match='add size=HEIGHTxWIDTH'):
        OnnxModel(path)
    assert OnnxModel(path, (4, 8)).describe(np.zeros((9, 9), np.uint8)).shape == (6,)


@pytest.mark.parametrize(
    ('options', 'problem'),
    [
        ({'shape': (1, 4, 8, 8)}, r'its input is image tensor\(float\) \[1, 4, 8, 8\]; expected'),
        ({'shape': (1, 192), 'operator': 'Log'}, 'expected one float tensor'),
        ({'kind': onnx.TensorProto.DOUBLE, 'operator': 'Log'}, r'tensor\(double\)'),
    ],
)
def test_a_model_of_another_input_is_refused_in_one_line(tmp_path, options, problem):
    with pytest.raises(SourceError, match=problem) as caught:
        OnnxModel(model(tmp_path / 'm.onnx', **options))
    assert '\n' not in str(caught.value)


def test_a_size_that_the_model_does_not_take_is_refused(tmp_path):
    with pytest.raises(SourceError, match='takes images of 8 x 8, not of 9 x 9'):
        OnnxModel(model(tmp_path / 'm.onnx'), (9, 9))
    with pytest.raises(SourceError, match='2 values of mean or std for 3 channels'):
        OnnxModel(model(tmp_path / 'm.onnx'), mean=(0.1, 0.2))


def test_what_is_no_model_is_refused(tmp_path):
    (tmp_path / 'm.onnx').write_text('hello')
    with pytest.raises(SourceError, match='not a readable ONNX model'):
        OnnxModel(tmp_path / 'm.onnx')
    with pytest.raises(SourceError, match='no such file'):
        OnnxModel(tmp_path / 'absent.onnx')


def test_an_answer_that_is_not_finite_is_refused(tmp_path):
    path = model(tmp_path / 'm.onnx', operator='Log')
    with pytest.raises(SourceError, match='its answer holds NaN'):
        OnnxModel(path).describe(np.zeros((8, 8), np.uint8))


def test_a_missing_onnxruntime_is_asked_for(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__('sys').modules, 'onnxruntime', None)
    with pytest.raises(SourceError, match='pip install onnxruntime'):
        OnnxModel(tmp_path / 'm.onnx')
