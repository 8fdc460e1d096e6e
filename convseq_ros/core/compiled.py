# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The library of compiled kernels, written in C, which setup.py builds if there is a compiler."""

from collections.abc import Callable
import ctypes
from dataclasses import dataclass
from functools import cache
from importlib import import_module
import os
from pathlib import Path
import sys
from typing import Any

import numpy as np

VERSION = 24  # of the kernels' arguments; native/cpu.c has the same number
# Instruction sets with kernels, best first; the two architectures share none.
VARIANTS = ('avx512', 'avxvnni', 'avx2', 'dotprod', 'neon')
_FOLDER = Path(__file__).parent
_OVERRIDE = 'CONVSEQ_KERNELS'  # environment variable: the variant to use, or numpy
_REBUILD = 'install a C compiler (apt install gcc) and build convseq_ros again'

SIZE, INT, FLOAT, DOUBLE = ctypes.c_ssize_t, ctypes.c_int, ctypes.c_float, ctypes.c_double


@dataclass(frozen=True, slots=True)
class Library:
    """The kernels of one variant; or why there are none, with the remedy."""

    variant: str = ''
    problem: str = ''
    functions: Any = None


@cache
def library() -> Library:
    """Return the kernels for this processor, or those that CONVSEQ_KERNELS selects."""
    requested, problem = os.environ.get(_OVERRIDE, ''), ''
    if requested == 'numpy':
        return Library(problem=f'{_OVERRIDE} is numpy; unset it')
    # The sources of a clone have no library beside them, but the installed package has one.
    installed = [Path(entry, *__name__.split('.')[:-1]) for entry in sys.path]
    paths = [path for folder in (_FOLDER, *installed) for path in folder.glob('_native*.so')]
    # In a home folder that several machines share, a library may be for another architecture.
    for path in dict.fromkeys(paths):
        if not (candidate := _load(path, requested)).problem:
            return candidate
        problem = problem or candidate.problem
    return Library(problem=problem or f'they were not built; {_REBUILD}')


def _load(path: Path, requested: str) -> Library:
    try:
        functions = ctypes.CDLL(str(path))
        version = functions.convseq_version()
    except (OSError, AttributeError) as error:
        return Library(problem=f'{error}; {_REBUILD}')
    if version != VERSION:
        return Library(problem=f'{path} is of another release; {_REBUILD}')
    reported = [name for name in VARIANTS if _has(functions, name)]
    usable = [name for name in reported if _works(functions, name)]
    if requested and requested not in usable:
        choices = ', '.join([*usable, 'numpy'])
        return Library(problem=f'{_OVERRIDE} is {requested}; this processor has {choices}')
    if reported and not usable:
        return Library(problem=f'this processor reports {reported[0]}, but does not support it')
    if not usable:
        return Library(problem='this processor has neither AVX2 nor NEON')
    return Library(requested or usable[0], '', functions)


def _has(functions: Any, variant: str) -> bool:
    test = getattr(functions, f'convseq_has_{variant}', None)
    return bool(test and test())


def _works(functions: Any, variant: str) -> bool:
    """Return whether a variant runs correctly: emulators may report support that they lack."""
    probe = ctypes.cast(functions[f'convseq_probe_{variant}'], ctypes.c_void_p)
    return not functions.convseq_tried(probe)


def available() -> bool:
    """Return whether there are compiled kernels for this processor."""
    return not library().problem


def slow_path() -> str:
    """Return a line that explains why NumPy is used, with the remedy; empty if it is not."""
    problem = library().problem
    return problem and f'no compiled kernels, frames take about 5 times longer: {problem}'


def kernels_of(package: str) -> Any:
    """Return a package's module `kernels`; without compiled kernels, its `numpy_kernels`."""
    return _module(f'{package}.{"kernels" if available() else "numpy_kernels"}')


_module = cache(import_module)


class Array:
    """An argument type of a kernel: a C-contiguous array of a data type, or None; or TypeError."""

    def __init__(self, dtype: str) -> None:
        self._dtype = np.dtype(dtype)

    def from_param(self, given: Any) -> ctypes.c_void_p:
        """Return the address of an array as an argument; a null pointer for None."""
        if given is None:
            return ctypes.c_void_p()
        if given.dtype != self._dtype or not given.flags.c_contiguous:
            raise TypeError(f'expected contiguous {self._dtype}, got {given.dtype}')
        return ctypes.c_void_p(address(given))


def address(given: Any) -> int:
    """Return the address of an array's data; faster than its attribute `ctypes`."""
    try:
        return ctypes.addressof(ctypes.c_char.from_buffer(given))
    except (TypeError, ValueError):  # the array is read-only or empty
        return int(given.ctypes.data)


def kernel(name: str, *arguments: Any) -> Callable[..., None]:
    """Return a kernel by its name and argument types; it runs without the interpreter's lock."""

    @cache
    def function() -> Any:
        compiled = library().functions[f'convseq_{name}_{library().variant}']
        compiled.argtypes, compiled.errcheck = arguments, _check
        return compiled

    def call(*given: Any) -> None:
        try:
            function()(*given)
        except ctypes.ArgumentError as error:
            # ctypes turns every exception during the conversion of arguments into this one.
            if KeyboardInterrupt.__name__ in str(error):
                raise KeyboardInterrupt from None
            raise

    return call


def numbers(name: str, count: int) -> list[int]:
    """Return the integers of a constant array that a kernel variant exports."""
    symbol = f'convseq_{name}_{library().variant}'
    return list((ctypes.c_int32 * count).in_dll(library().functions, symbol))


def _check(result: int, function: Any, _arguments: Any) -> None:
    if result:
        raise MemoryError(f'no memory for {function.__name__}')
