# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Descriptors from ONNX models, small ones that are made here, and models that are not to be."""

import os

from convseq_ros.errors import ModelError
from convseq_ros.models.onnx_model import OnnxModel
from descriptor_models import made
import numpy as np
import onnx
import pytest

NOTHING = {'mean': 0, 'scale': 1}


def graph_model(path, nodes, shape, kind=onnx.TensorProto.FLOAT, out=None, weights=(), domain=''):
    """Write a model from `image` to `descriptor`."""
    helper = onnx.helper
    graph = helper.make_graph(
        nodes,
        'small',
        [helper.make_tensor_value_info('image', kind, shape)],
        [helper.make_tensor_value_info('descriptor', kind, out)],
        weights,
    )
    opsets = [helper.make_opsetid('', 13), *([helper.make_opsetid(domain, 1)] if domain else [])]
    return saved(helper.make_model(graph, opset_imports=opsets, ir_version=8), path)


def model(path, shape=(1, 3, 8, 8), operator='AveragePool', domain='', **more):
    """Write a model whose vector are the means of 4 x 4 px, channel by channel."""
    options = {'kernel_shape': [4, 4], 'strides': [4, 4]} if operator == 'AveragePool' else {}
    node = onnx.helper.make_node(operator, ['image'], ['descriptor'], domain=domain, **options)
    return graph_model(path, [node], shape, domain=domain, **more)


def saved(one, path, **metadata):
    if metadata:
        onnx.helper.set_model_props(one, metadata)
    path.write_bytes(one.SerializeToString())
    return path


def with_weights_in(location, path):
    """Write a model that adds 192 weights from a file."""
    shape, kind = (1, 3, 8, 8), onnx.TensorProto.FLOAT
    weights = onnx.TensorProto(name='w', data_type=kind, dims=shape)
    weights.data_location = onnx.TensorProto.EXTERNAL
    for key, value in (('location', location), ('offset', '0'), ('length', '768')):
        weights.external_data.add(key=key, value=value)
    node = onnx.helper.make_node('Add', ['image', 'w'], ['descriptor'])
    return graph_model(path, [node], shape, out=shape, weights=[weights])


def refused(match, path, names=None, **settings):
    """Have a model refused, in one line that names a file."""
    with pytest.raises(ModelError, match=match) as caught:
        OnnxModel(path, **settings)
    assert '\n' not in str(caught.value) and (names or str(path)) in str(caught.value)


def test_a_vector_is_the_models_output_for_the_normalised_image(tmp_path):
    image = np.zeros((8, 8), np.uint8)
    image[:4] = 255
    own = OnnxModel(model(tmp_path / 'm.onnx'), given={'mean': [0.5], 'scale': 0.25})
    assert own(image).tolist() == [2, 2, -2, -2] * 3
    assert own.numbers == 12
    # One of a free batch size gets one image, a grey one one channel.
    free = OnnxModel(model(tmp_path / 'm.onnx', ('images', 3, 8, 8)))
    assert free(np.full((8, 8), 9, np.uint8)).shape == (12,)
    grey = OnnxModel(model(tmp_path / 'm.onnx', (1, 1, 8, 8)), given=NOTHING)
    assert grey(np.full((20, 30), 255, np.uint8)).tolist() == [1, 1, 1, 1]


CONTRADICTIONS = {
    'mean: 0.1': 'mean .* contradicts the model',
    'size: [4, 9]': 'size .* contradicts the model',
    'colour: rgb': "'colour' is none of mean, scale, size",
    'scale: 0': 'is not 0',
    'mean: [a, b]': 'could not convert',
}


def test_metadata_and_a_yaml_file_set_how_images_become_the_input(tmp_path):
    one = onnx.load(model(tmp_path / 'm.onnx', ('n', 3, 'h', 'w')))
    path = saved(one, tmp_path / 'm.onnx', size='4x8', mean='0.5, 0.5, 0.5')
    alone = OnnxModel(path)
    assert alone.numbers == 6
    (tmp_path / 'm.yaml').write_text('mean: [0.5, 0.5, 0.5]\nscale: 0.25\n')
    both = OnnxModel(path)
    assert both(np.full((9, 9), 255, np.uint8)).tolist() == [2.0] * 6
    # What decides the vector is part of what the model is.
    assert alone.identity != both.identity
    for line, problem in CONTRADICTIONS.items():
        (tmp_path / 'm.yaml').write_text(f'{line}\n')
        refused(problem, path, names='m.yaml')


def test_a_size_that_is_missing_or_contradicts_the_model_is_refused(tmp_path):
    refused('takes images of any size', model(tmp_path / 'm.onnx', ('n', 3, 'height', 'width')))
    path = model(tmp_path / 'm.onnx')
    refused(r'size \(9, 9\) contradicts the model, which says \(8, 8\)', path, given={'size': 9})
    refused('2 values of mean or scale for 3 channels', path, given={'mean': [0.1, 0.2]})


@pytest.mark.parametrize(
    ('options', 'problem'),
    [
        ({'shape': (1, 4, 8, 8)}, r'its input is image tensor\(float\) \[1, 4, 8, 8\]; expected'),
        ({'shape': (1, 192), 'operator': 'Abs'}, 'expected one float tensor'),
        ({'shape': (8, 3, 8, 8), 'operator': 'Abs'}, 'expected one float tensor'),
        ({'kind': onnx.TensorProto.DOUBLE, 'operator': 'Abs'}, r'tensor\(double\)'),
        ({'operator': 'Mine', 'domain': 'my.own'}, 'standard operators'),
        ({'operator': 'Log'}, 'holds NaN'),
    ],
)
def test_a_model_of_another_input_operator_or_output_is_refused(tmp_path, options, problem):
    refused(problem, model(tmp_path / 'm.onnx', **options))


def test_an_invalid_model_is_refused(tmp_path):
    path = tmp_path / 'm.onnx'
    for content in (b'hello', b'', b'\x08', bytes(100), b'\xff' * 50, b'\x08\1' * 2000):
        path.write_bytes(content)
        refused('ONNX model', path)
    refused('no such file', tmp_path / 'absent.onnx')
    os.mkfifo(tmp_path / 'pipe.onnx')
    refused('is a pipe', tmp_path / 'pipe.onnx')


def test_a_vector_whose_size_changes_is_reported(tmp_path):
    nodes = [
        onnx.helper.make_node('NonZero', ['image'], ['where']),
        onnx.helper.make_node('Cast', ['where'], ['descriptor'], to=onnx.TensorProto.FLOAT),
    ]
    own = OnnxModel(graph_model(tmp_path / 'm.onnx', nodes, (1, 1, 8, 8)), given=NOTHING)
    with pytest.raises(ModelError, match=r'numbers, expected .*, as others'):
        own(np.eye(8, dtype=np.uint8))


def test_a_missing_onnxruntime_is_reported_with_the_remedy(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__('sys').modules, 'onnxruntime', None)
    refused('pip install onnxruntime', tmp_path / 'm.onnx')


def test_a_model_of_3_gb_is_refused_unread(tmp_path):
    path = tmp_path / 'm.onnx'
    with path.open('wb') as file:
        file.truncate(3 << 30)
    refused(r'3\.22e\+03 MB is more than max_file_mb, 256; .*set max_file_mb to 3221', path)
    # So are weights beside it that are as large.
    with_weights_in('m.onnx.data', path)
    with (tmp_path / 'm.onnx.data').open('wb') as file:
        file.truncate(3 << 30)
    refused('max_file_mb', path)


def test_weights_are_read_from_the_file_where_pytorch_writes_them_alone(tmp_path):
    folder = tmp_path / 'model'
    folder.mkdir()
    path = with_weights_in('m.onnx.data', folder / 'm.onnx')
    weights = folder / 'm.onnx.data'
    np.arange(192, dtype=np.float32).tofile(weights)
    own = OnnxModel(path, given=NOTHING)
    assert own(np.zeros((8, 8), np.uint8)).tolist() == [*range(192)]
    np.ones(192, np.float32).tofile(weights)
    assert OnnxModel(path, given=NOTHING).identity != own.identity
    weights.rename(folder / 'w.bin')
    refused('in it or in m.onnx.data', path)
    for other in ('w.bin', '../secret.bin', str(folder / 'w.bin'), '/etc/passwd'):
        refused('in it or in m.onnx.data', with_weights_in(other, path))


def test_a_model_replaced_on_disk_has_another_identity(tmp_path):
    path = made(tmp_path / 'net.onnx', 'hog', 32, 64)
    before = OnnxModel(path)
    kept = before(np.zeros((8, 8), np.uint8))
    after = OnnxModel(made(path, 'random', 32, 64))
    assert before.identity != after.identity
    assert (before(np.zeros((8, 8), np.uint8)) == kept).all()
