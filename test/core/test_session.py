# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A session is ready when it has warmed up, and says which settings it cannot follow."""

from dataclasses import replace
import subprocess
import sys

from convseq_ros.config import Config, KeyframeConfig
from convseq_ros.core.compiled import available
from convseq_ros.core.map_builder import build_map
from convseq_ros.core.session import Session
from convseq_ros.core.types import Frame
import numpy as np
import pytest

# Prints the compiled functions that gained a signature while frames came.
COMPILED_LATE = """
import importlib, pkgutil
import numpy as np
from convseq_ros.config import make_config
from convseq_ros.core import encoding, map as places, similarity
from convseq_ros.core.session import Session
from convseq_ros.core.types import Frame
import convseq_ros.core.similarity.kernels as kernels

def signatures():
    modules = [importlib.import_module(f'{kernels.__name__}.{each.name}')
               for each in pkgutil.iter_modules(kernels.__path__)]
    modules += [importlib.import_module(f'{room.__name__}.kernels') for room in (encoding, places)]
    return {(module.__name__, name): len(each.signatures) for module in modules
            for name, each in vars(module).items() if hasattr(each, 'signatures')}

session = Session(None, make_config({'mode': 'online', 'exclusion_s': 5.0}))
session.warm_up()
before = signatures()
for index in range(40):
    gray = np.random.default_rng(index % 20).integers(0, 256, (48, 64), np.uint8)
    session.recognizer.process(Frame(index * 10**9, gray))
after = signatures()
print(sorted(name for name in after if after[name] != before[name]))
"""


@pytest.mark.skipif(not available(), reason='needs numba')
def test_nothing_is_compiled_after_the_warm_up():
    result = subprocess.run(
        [sys.executable, '-c', COMPILED_LATE], capture_output=True, text=True, check=False
    )
    assert result.stdout.strip() == '[]', result.stdout + result.stderr


def test_a_map_of_other_keyframes_than_asked_for_is_used_and_says_so(tmp_path):
    path = tmp_path / 'map.db'
    made = KeyframeConfig(keyframe_interval_s=0.5)
    frames = [Frame(index * 10**9, np.full((48, 64), index, np.uint8)) for index in range(3)]
    build_map(frames, path, Config(keyframes=replace(made, keyframe_overlap=1.0)))
    assert Session(path, Config()).ignored == []
    other = Session(path, Config(keyframes=replace(made, keyframe_interval_s=2.0)))
    assert other.ignored == [
        f'keyframe_interval_s 2.0 is ignored: {path} was made with 0.5; build the map again to '
        'change it'
    ]
