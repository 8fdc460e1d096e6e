# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A library that cannot be used is one line and not an error; nothing is written at run time."""

import os
from pathlib import Path
import shutil
import subprocess
import sys

from convseq_ros.core import compiled
import pytest

INSTALLED = Path(compiled.__file__).parents[1]  # the package, which need not be the repository's
# The first bytes of a library for 64-bit ARM, and for x86-64.
ARM = b'\x7fELF\x02\x01\x01' + bytes(9) + b'\x03\x00\xb7\x00\x01\x00\x00\x00' + bytes(40)
X86 = ARM.replace(b'\xb7', b'\x3e')


def needs_library():
    if not compiled.available():
        pytest.skip(f'no compiled kernels: {compiled.library().problem}')


def found_in(folder, monkeypatch, **environment):
    monkeypatch.setattr(compiled, '_FOLDER', folder)
    monkeypatch.setattr(sys, 'path', [])
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    return compiled.library.__wrapped__()


def test_without_a_library_the_remedy_is_told(tmp_path, monkeypatch):
    found = found_in(tmp_path, monkeypatch)
    assert found.variant == '' and 'apt install gcc' in found.problem


@pytest.mark.parametrize('content', [ARM, X86, b'', b'not a library'])
def test_a_library_that_cannot_be_loaded_is_one_line(tmp_path, monkeypatch, content):
    (tmp_path / '_native.abi3.so').write_bytes(content)
    found = found_in(tmp_path, monkeypatch)
    assert found.variant == '' and str(tmp_path) in found.problem
    assert 'build convseq_ros again' in found.problem and '\n' not in found.problem


def test_a_library_of_another_release_is_not_used(monkeypatch):
    needs_library()
    monkeypatch.setattr(compiled, 'VERSION', compiled.VERSION + 1)
    found = found_in(compiled._FOLDER, monkeypatch)
    assert found.variant == '' and 'another release' in found.problem


def test_kernels_that_the_processor_lacks_are_not_used(monkeypatch):
    needs_library()
    found = found_in(compiled._FOLDER, monkeypatch, CONVSEQ_KERNELS='mmx')
    assert found.variant == '' and 'CONVSEQ_KERNELS is mmx; this processor has ' in found.problem


def test_arguments_of_another_type_are_refused():
    needs_library()
    import ctypes

    import numpy as np

    shape = compiled.kernel('shape', compiled.array('i4'))
    for wrong in (np.zeros(4, np.float32), np.zeros(8, np.int32)[::2]):
        with pytest.raises(ctypes.ArgumentError):
            shape(wrong)


def test_nothing_is_written_where_the_package_is_installed(tmp_path):
    needs_library()
    shutil.copytree(INSTALLED, tmp_path / 'convseq_ros')
    for cached in tmp_path.rglob('__pycache__'):
        shutil.rmtree(cached)

    def state():
        return {path: path.stat().st_mtime_ns for path in tmp_path.rglob('*')}

    before = state()
    lines = (
        'import numpy as np\n'
        'from convseq_ros.core.compiled import available\n'
        'from convseq_ros.core.session import Session\n'
        'from convseq_ros.config import Config\n'
        'Session(None, Config()).warm_up()\n'
        'print(available())\n'
    )
    result = subprocess.run(
        [sys.executable, '-B', '-c', lines],
        env=os.environ | {'PYTHONPATH': str(tmp_path)},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.stdout == 'True\n', result.stderr
    assert state() == before
