# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Write an ONNX model without training, to try and to test `descriptor_model`.

Usage: python scripts/make_onnx_model.py net.onnx [--kind hog|random]. `hog` computes histograms of
gradient directions in 8 x 8 cells of a grey image, each of unit length. `random` computes random
convolutions of a colour image, averages them over 6 x 6 cells and projects them at random. Needs
`pip install onnx`.
"""

import argparse
from pathlib import Path
import sys

import numpy as np
import onnx
from onnx import helper, numpy_helper, TensorProto

DIRECTIONS, CELLS, SEED = 8, 8, 0
OPSET, IR = 13, 8  # supported by onnxruntime 1.10 and later


def main() -> int:
    """Write the model."""
    parser = argparse.ArgumentParser(allow_abbrev=False, description=__doc__)
    parser.add_argument('output', type=Path)
    parser.add_argument('--kind', choices=('hog', 'random'), default='hog')
    chosen = parser.parse_args()
    chosen.output.write_bytes(make_model(chosen.kind).SerializeToString())
    return 0


def make_model(kind: str = 'hog', size: int = 96, numbers: int = 512) -> onnx.ModelProto:
    """Return a model with a square input in px, and so many numbers in its vector."""
    nodes, constants = {'hog': _hog, 'random': _random}[kind](size, numbers)
    channels = {'hog': 1, 'random': 3}[kind]
    shape = 'images', channels, size, size  # any number of images at once
    graph = helper.make_graph(
        nodes,
        kind,
        [helper.make_tensor_value_info('image', TensorProto.FLOAT, shape)],
        [helper.make_tensor_value_info('descriptor', TensorProto.FLOAT, ('images', numbers))],
        [numpy_helper.from_array(value.astype(np.float32), name) for name, value in constants],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid('', OPSET)], ir_version=IR)
    # How images are prepared.
    helper.set_model_props(model, {'size': f'{size}x{size}', 'mean': '0.5', 'scale': '0.25'})
    onnx.checker.check_model(model)
    return model


def _hog(size: int, numbers: int) -> tuple[list[onnx.NodeProto], list[tuple[str, np.ndarray]]]:
    """Return a network for the gradient strength per direction and cell, and its constants."""
    angles = np.arange(DIRECTIONS) * 2 * np.pi / DIRECTIONS
    across = np.array([[-1, 0, 1], [-2, 0, 2], [-1, 0, 1]]) / 8
    filters = np.cos(angles)[:, None, None] * across + np.sin(angles)[:, None, None] * across.T
    cell = size // CELLS
    nodes = [
        helper.make_node('Conv', ['image', 'filters'], ['edges'], pads=[1, 1, 1, 1]),
        helper.make_node('Relu', ['edges'], ['strengths']),
        helper.make_node(
            'AveragePool', ['strengths'], ['cells'], kernel_shape=[cell] * 2, strides=[cell] * 2
        ),
        helper.make_node('Add', ['cells', 'little'], ['positive']),
        helper.make_node('LpNormalization', ['positive'], ['units'], axis=1, p=2),
        helper.make_node('Flatten', ['units'], ['flat']),
        helper.make_node('MatMul', ['flat', 'projection'], ['descriptor']),
    ]
    side = size // cell
    inputs = DIRECTIONS * side * side
    return nodes, [
        ('filters', filters[:, None]),
        ('little', np.full(1, 1e-3)),
        ('projection', _projection(inputs, numbers)),
    ]


def _random(size: int, numbers: int) -> tuple[list[onnx.NodeProto], list[tuple[str, np.ndarray]]]:
    """Return two layers of random convolutions with means per cell and a projection."""
    random = np.random.default_rng(SEED)
    cell = size // 4 // 6
    nodes = [
        helper.make_node('Conv', ['image', 'first'], ['a'], strides=[2, 2], pads=[2, 2, 2, 2]),
        helper.make_node('Relu', ['a'], ['b']),
        helper.make_node('Conv', ['b', 'second'], ['c'], strides=[2, 2], pads=[1, 1, 1, 1]),
        helper.make_node('Relu', ['c'], ['d']),
        helper.make_node(
            'AveragePool', ['d'], ['cells'], kernel_shape=[cell] * 2, strides=[cell] * 2
        ),
        helper.make_node('Flatten', ['cells'], ['flat']),
        helper.make_node('MatMul', ['flat', 'projection'], ['descriptor']),
    ]
    first, second = random.normal(size=(16, 3, 5, 5)), random.normal(size=(32, 16, 3, 3))
    side = (size // 4 - cell) // cell + 1
    return nodes, [
        ('first', (first - first.mean(axis=(1, 2, 3), keepdims=True)) / 5),
        ('second', (second - second.mean(axis=(1, 2, 3), keepdims=True)) / 12),
        ('projection', _projection(32 * side * side, numbers)),
    ]


def _projection(inputs: int, numbers: int) -> np.ndarray:
    """Return a random projection (inputs, numbers); the identity if both are equal."""
    if inputs == numbers:
        return np.eye(numbers)
    return np.random.default_rng(SEED).normal(size=(inputs, numbers)) / numbers**0.5


if __name__ == '__main__':
    sys.exit(main())
