# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A library that cannot be used is one line and not an error; nothing is written at run time."""

import ctypes
import os
from pathlib import Path
import shutil
import sys

from convseq_ros.app import pipeline
from convseq_ros.config import make_config
from convseq_ros.core import compiled
import numpy as np
from programs import needs_library, run
import pytest

pytestmark = pytest.mark.once

INSTALLED = Path(compiled.__file__).parents[1]  # the package, which need not be the repository's
# The first bytes of a library for 64-bit ARM, and for x86-64.
ARM = b'\x7fELF\x02\x01\x01' + bytes(9) + b'\x03\x00\xb7\x00\x01\x00\x00\x00' + bytes(40)
X86 = ARM.replace(b'\xb7', b'\x3e')


def found_in(folder, monkeypatch, **environment):
    monkeypatch.setattr(compiled, '_FOLDER', folder)
    monkeypatch.setattr(sys, 'path', [])
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    return compiled.library.__wrapped__()


@pytest.mark.parametrize('content', [None, ARM, X86, b'', b'not a library'])
def test_a_library_that_cannot_be_loaded_is_reported_in_one_line(tmp_path, monkeypatch, content):
    if content is not None:
        (tmp_path / '_native.abi3.so').write_bytes(content)
    found = found_in(tmp_path, monkeypatch)
    told = 'apt install gcc' if content is None else 'build convseq_ros again'
    assert found.variant == '' and told in found.problem and '\n' not in found.problem
    assert content is None or str(tmp_path) in found.problem


@pytest.mark.parametrize(
    ('version', 'asked', 'told'),
    [(1, {}, 'another release'),
     (0, {'CONVSEQ_KERNELS': 'mmx'}, 'CONVSEQ_KERNELS is mmx; this processor has ')],
)  # fmt: skip
def test_kernels_that_do_not_suit_are_not_used(monkeypatch, version, asked, told):
    needs_library()
    monkeypatch.setattr(compiled, 'VERSION', compiled.VERSION + version)
    found = found_in(compiled._FOLDER, monkeypatch, **asked)
    assert found.variant == '' and told in found.problem


WARMED = """
from convseq_ros.core.compiled import available
from convseq_ros.app.pipeline import Pipeline
from convseq_ros.config import Config
Pipeline(None, Config()).warm_up()
print(available())
"""


def test_nothing_is_written_where_the_package_is_installed(tmp_path):
    needs_library()
    ignored = shutil.ignore_patterns('__pycache__')
    shutil.copytree(INSTALLED, tmp_path / 'convseq_ros', ignore=ignored)

    def state():
        return {path: path.stat().st_mtime_ns for path in tmp_path.rglob('*')}

    before, environment = state(), os.environ | {'PYTHONPATH': str(tmp_path)}
    result = run(sys.executable, '-B', '-c', WARMED, env=environment, cwd=tmp_path)
    assert result.stdout == 'True\n', result.stderr
    assert state() == before


@pytest.mark.parametrize('content', [ARM, b''])
def test_the_library_that_can_be_loaded_is_taken_of_several(tmp_path, monkeypatch, content):
    needs_library()
    (built,) = compiled._FOLDER.glob('_native*.so')
    (tmp_path / '_native.0.so').write_bytes(content)
    shutil.copy(built, tmp_path / '_native.1.so')
    assert not found_in(tmp_path, monkeypatch).problem


PROBED = """
import ctypes, mmap
from convseq_ros.core.compiled import library
page = mmap.mmap(-1, 4096, prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC)
page.write(b"\\x0f\\x0b" if library().variant.startswith("avx") else bytes(4))
probe = ctypes.addressof(ctypes.c_char.from_buffer(page))
for _ in range(2):
    print(library().functions.convseq_tried(ctypes.c_void_p(probe)))
"""


def test_an_instruction_that_is_not_there_ends_a_probe_and_not_the_process():
    needs_library()
    result = run(sys.executable, '-c', PROBED, cwd=INSTALLED.parent)
    assert result.stdout.split() == ['1', '1'], result.stderr


def test_kernels_whose_probe_fails_are_not_used(monkeypatch):
    needs_library()
    best = compiled.library().variant
    works = compiled._works
    monkeypatch.setattr(compiled, '_works', lambda *of: of[1] != best and works(*of))
    found = found_in(compiled._FOLDER, monkeypatch)
    assert found.variant != best
    monkeypatch.setattr(compiled, '_works', lambda *_: False)
    assert f'reports {best}' in found_in(compiled._FOLDER, monkeypatch).problem
    asked = found_in(compiled._FOLDER, monkeypatch, CONVSEQ_KERNELS=best)
    assert 'this processor has numpy' in asked.problem


def test_a_signal_during_an_argument_check_is_no_wrong_argument():
    needs_library()

    class Interrupted:
        @property
        def dtype(self):
            raise KeyboardInterrupt

    peak = compiled.kernel('peak', compiled.SIZE, compiled.Array('i4'))
    with pytest.raises(KeyboardInterrupt):
        peak(1, Interrupted())
    with pytest.raises(ctypes.ArgumentError, match='expected contiguous int32'):
        peak(1, np.zeros(4))


def test_a_slow_pipeline_gives_the_reason(monkeypatch):
    monkeypatch.setattr(pipeline, 'slow_path', lambda: 'no compiled kernels: install gcc')
    made = pipeline.Pipeline(None, make_config({'mode': 'online'}))
    assert made.slow == 'no compiled kernels: install gcc'
