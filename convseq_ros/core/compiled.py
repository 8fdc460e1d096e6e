# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The library of compiled kernels, C in `native`, which setup.py builds where it can."""

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

VERSION = 23  # of the kernels' arguments; native/cpu.c has the same
# Kinds of processors that there are kernels for, best first; the two architectures share none.
VARIANTS = ('avx512', 'avxvnni', 'avx2', 'dotprod', 'neon')
_FOLDER = Path(__file__).parent
_OVERRIDE = 'CONVSEQ_KERNELS'  # environment: the kind of kernels to use, or numpy
_REBUILD = 'install a C compiler (apt install gcc) and build convseq_ros again'

SIZE, INT, FLOAT, DOUBLE = ctypes.c_ssize_t, ctypes.c_int, ctypes.c_float, ctypes.c_double


@dataclass(frozen=True, slots=True)
class Library:
    """What was found: the kernels of one kind, or why there are none, with the remedy."""

    variant: str = ''
    problem: str = ''
    functions: Any = None


@cache
def library() -> Library:
    """Return the kernels for this processor, or as CONVSEQ_KERNELS asks."""
    asked, problem = os.environ.get(_OVERRIDE, ''), ''
    if asked == 'numpy':
        return Library(problem=f'{_OVERRIDE} is numpy; unset it')
    # Run from a clone, sources have no library beside them, but the installed package has one.
    installed = [Path(entry, *__name__.split('.')[:-1]) for entry in sys.path]
    found = [path for folder in (_FOLDER, *installed) for path in folder.glob('_native*.so')]
    # In a home that several machines share, the first may be of another kind of processors.
    for path in dict.fromkeys(found):
        if not (tried := _loaded(path, asked)).problem:
            return tried
        problem = problem or tried.problem
    return Library(problem=problem or f'they were not built; {_REBUILD}')


def _loaded(path: Path, asked: str) -> Library:
    try:
        functions = ctypes.CDLL(str(path))
        version = functions.convseq_version()
    except (OSError, AttributeError) as error:
        return Library(problem=f'{error}; {_REBUILD}')
    if version != VERSION:
        return Library(problem=f'{path} is of another release; {_REBUILD}')
    told = [name for name in VARIANTS if _has(functions, name)]
    there = [name for name in told if _works(functions, name)]
    if asked and asked not in there:
        known = ', '.join([*there, 'numpy'])
        return Library(problem=f'{_OVERRIDE} is {asked}; this processor has {known}')
    if told and not there:
        return Library(problem=f'this processor says that it has {told[0]}, but has not')
    if not there:
        return Library(problem='this processor has neither AVX2 nor NEON')
    return Library(asked or there[0], '', functions)


def _has(functions: Any, variant: str) -> bool:
    tells = getattr(functions, f'convseq_has_{variant}', None)
    return bool(tells and tells())


def _works(functions: Any, variant: str) -> bool:
    """Return whether kernels compute what they should: emulators may say more than is true."""
    probe = ctypes.cast(functions[f'convseq_probe_{variant}'], ctypes.c_void_p)
    return not functions.convseq_tried(probe)


def available() -> bool:
    """Return whether there are compiled kernels for this processor."""
    return not library().problem


def slow_path() -> str:
    """Return a line that says why NumPy computes all, and what to do about it; empty if not."""
    problem = library().problem
    return problem and f'no compiled kernels, frames take about 5 times longer: {problem}'


def kernels_of(package: str) -> Any:
    """Return a package's `kernels`, or `numpy_kernels`, the same functions, if none are there."""
    return _module(f'{package}.{"kernels" if available() else "numpy_kernels"}')


_module = cache(import_module)


class Array:
    """The type of an argument: a C-contiguous array, or None; TypeError if another is given."""

    def __init__(self, dtype: np.dtype[Any]) -> None:
        self._dtype = dtype

    def from_param(self, given: Any) -> ctypes.c_void_p:
        """Return its address."""
        if given is None:
            return ctypes.c_void_p()
        if given.dtype != self._dtype or not given.flags.c_contiguous:
            raise TypeError(f'expected contiguous {self._dtype}, got {given.dtype}')
        return ctypes.c_void_p(address(given))


def address(given: Any) -> int:
    """Return where the numbers of an array begin; quicker than its own `ctypes` tells."""
    try:
        return ctypes.addressof(ctypes.c_char.from_buffer(given))
    except (TypeError, ValueError):  # it may not be written to, or is empty
        return int(given.ctypes.data)


def array(dtype: Any) -> Array:
    """Return the type of an argument that is a C-contiguous array of numbers of a type."""
    return Array(np.dtype(dtype))


def kernel(name: str, *arguments: Any) -> Callable[..., None]:
    """Return a kernel by its name, given its arguments' types; it runs without Python's lock."""

    @cache
    def function() -> Any:
        found = library().functions[f'convseq_{name}_{library().variant}']
        found.argtypes, found.errcheck = arguments, _check
        return found

    def call(*given: Any) -> None:
        try:
            function()(*given)
        except ctypes.ArgumentError as error:
            # ctypes says so of whatever comes up while it looks at an argument.
            if KeyboardInterrupt.__name__ in str(error):
                raise KeyboardInterrupt from None
            raise

    return call


def numbers(name: str, count: int) -> list[int]:
    """Return whole numbers that the kernels' kind tells of itself."""
    told = (ctypes.c_int32 * count).in_dll(
        library().functions, f'convseq_{name}_{library().variant}'
    )
    return list(told)


def _check(result: int, function: Any, _arguments: Any) -> None:
    if result:
        raise MemoryError(f'no memory for {function.__name__}')
