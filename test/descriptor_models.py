# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Descriptor models for tests, from the script that everybody can make some with."""

import importlib.util
from pathlib import Path

import pytest

onnx = pytest.importorskip('onnx', reason='needs onnx to make a model')
pytest.importorskip('onnxruntime', reason='needs onnxruntime to run a model')
_SCRIPT = Path(__file__).resolve().parents[1] / 'scripts' / 'make_onnx_model.py'


def made(path, kind='hog', size=96, numbers=512):
    """Write a model, and return its path."""
    found = importlib.util.spec_from_file_location('make_onnx_model', _SCRIPT)
    script = importlib.util.module_from_spec(found)
    found.loader.exec_module(script)
    path.write_bytes(script.make_model(kind, size, numbers).SerializeToString())
    return path
