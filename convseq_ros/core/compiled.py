# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Functions compiled by numba, where a numba that vectorises well is installed."""

from collections.abc import Callable
from contextlib import suppress
from functools import cache, wraps
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
import os
from pathlib import Path
import re
import stat
import tempfile
from typing import Any

_LEAST_NUMBA = (0, 61)


@cache
def available() -> bool:
    """Return whether functions are compiled; numba before 0.61 is slower than NumPy."""
    try:
        found = re.match(r'(\d+)\.(\d+)', version('numba'))
        if not found or tuple(map(int, found.groups())) < _LEAST_NUMBA:
            return False
        return not import_module('numba').config.DISABLE_JIT
    except (ImportError, PackageNotFoundError):
        return False


def kernels_of(package: str) -> Any:
    """Return a package's `kernels`, or `numpy_kernels`, the same functions, if none compile."""
    return _module(f'{package}.{"kernels" if available() else "numpy_kernels"}')


_module = cache(import_module)


def compiled(function: Callable[..., Any]) -> Any:
    """
    Return a function that numba compiles when it is called first; itself where numba is not.

    Compiled code is kept beside the source, or in the user's cache, or in a folder of the user's
    among the temporary ones: the first of these that can be written, else in memory alone. It is
    made anew when any module in the function's folder has changed. Callers may run in threads.
    """
    if not available():
        return function
    numba: Any = import_module('numba')
    usual = numba.config.CACHE_DIR
    for folder in (usual, _private_folder(), None):
        numba.config.CACHE_DIR = folder or usual
        try:
            made = numba.njit(
                cache=folder is not None, nogil=True, boundscheck=False, error_model='numpy'
            )(function)
            break
        except RuntimeError:
            continue
        finally:
            numba.config.CACHE_DIR = usual
    with suppress(AttributeError):
        # numba looks at the function's own file only, not at those it takes code from.
        made._cache._cache_file._source_stamp = _stamp(Path(function.__code__.co_filename).parent)
    return made


@cache
def _stamp(folder: Path) -> tuple[tuple[str, int, int], ...]:
    """Return what tells one state of the modules of a folder from another."""
    states = ((path.name, path.stat()) for path in sorted(folder.glob('*.py')))
    return tuple((name, state.st_mtime_ns, state.st_size) for name, state in states)


@cache
def _private_folder() -> str | None:
    """Return a temporary folder that only this user can write, if there is one."""
    try:
        folder = Path(tempfile.gettempdir(), f'convseq_ros-{os.getuid()}')
        folder.mkdir(mode=stat.S_IRWXU, exist_ok=True)
        state = folder.lstat()
    except OSError:
        return None
    private = stat.S_ISDIR(state.st_mode) and state.st_uid == os.getuid()
    return str(folder) if private and not state.st_mode & (stat.S_IWGRP | stat.S_IWOTH) else None


def emitted(result: str) -> Callable[[Callable[..., Any]], Any]:
    """
    Return a decorator for functions that write LLVM instructions into compiled ones.

    Parameters
    ----------
    result : str
        Name of the numba type that is returned; `none` for nothing.

    Returns
    -------
    callable
        Takes a function of an IR builder and integers (addresses, mostly) and returns one of these
        integers alone, for compiled functions to call.

    """

    def decorated(emit: Callable[..., Any]) -> Any:
        if not available():
            return emit
        numba: Any = import_module('numba')
        number, kind = numba.types.int64, getattr(numba.types, result)

        @wraps(emit)
        def typed(_context: Any, *arguments: Any) -> Any:
            def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
                value = emit(builder, *values)
                return context.get_dummy_value() if value is None else value

            return kind(*[number] * len(arguments)), generate

        return import_module('numba.extending').intrinsic(typed)

    return decorated
