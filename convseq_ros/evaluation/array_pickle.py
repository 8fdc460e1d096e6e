# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Arrays of objects in a pickle of a stranger, without what a pickle may do else.

No name of a pickle leads to NumPy, whose own way to fill an array believes what it is told of its
type, and then reads where there is nothing. The module of Python that reads pickles is used, not
that in C, which takes the memory for a number of a name before it looks at the name.
"""

from collections.abc import Callable, Sequence
import io
import math
import pickle  # nosec B403
import re
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

_PLAIN = re.compile(r'[biufSU]\d{1,6}')  # types of numbers and texts, with their size
_OBJECT = re.compile(r'O\d?')
_ORDERS = '<>|='


class _Type:
    """Stands in for NumPy's dtype: its name, and its byte order."""

    def __init__(self, name: str, *_: object) -> None:
        self.name, self.order = str(name), '='

    def __setstate__(self, state: Sequence[Any]) -> None:
        self.order = str(state[1])

    @property
    def is_object(self) -> bool:
        return bool(_OBJECT.fullmatch(self.name))

    def values(self, data: bytes | str) -> list[Any]:
        """Return the numbers or texts in some bytes."""
        if not _PLAIN.fullmatch(self.name) or self.order not in _ORDERS:
            raise pickle.UnpicklingError(f'holds values of type {self.name}')
        content = data.encode('latin1') if isinstance(data, str) else bytes(data)
        return list(np.frombuffer(content, self.order + self.name).tolist())


class _Array:
    """Stands in for an array, of which it keeps the values, in the order of memory."""

    values: Sequence[Any] = ()

    def __setstate__(self, state: Sequence[Any]) -> None:
        *_, kind, _, data = state
        self.values = list(data) if kind.is_object else kind.values(data)


def _scalar(kind: _Type, data: Any) -> Any:
    return data if kind.is_object else kind.values(data)[0]


class _Unpickler(pickle._Unpickler):
    def find_class(self, module: str, name: str) -> Callable[..., Any]:
        # A pickle can change what it is given, so that each is given its own function.
        if module in ('numpy.core.multiarray', 'numpy._core.multiarray'):
            if name == '_reconstruct':
                return lambda *_: _Array()
            if name == 'scalar':
                return lambda kind, data: _scalar(kind, data)
        elif (module, name) == ('numpy', 'dtype'):
            return lambda name, *_: _Type(name)
        elif (module, name) == ('numpy', 'ndarray'):
            return lambda *_: None  # is only named
        elif (module, name) == ('_codecs', 'encode'):
            return lambda text, _: text.encode('latin1')
        raise pickle.UnpicklingError(f'holds {module}.{name}, which is no array')


def read_objects(
    file: BinaryIO, shape: tuple[int, ...], is_fortran: bool
) -> npt.NDArray[np.object_]:
    """
    Return an array of objects of a shape; arrays in it are flat lists.

    The file stands behind the header of a .npy file, which gives the shape and the order; all of
    it is read. Raises an exception of any kind if it holds no such array.
    """
    found = _Unpickler(io.BytesIO(file.read()), encoding='latin1').load()
    if not isinstance(found, _Array) or len(found.values) != math.prod(shape):
        raise ValueError(f'holds no array of shape {shape}')
    stored = np.empty(len(found.values), object)
    for index, value in enumerate(found.values):
        stored[index] = value.values if isinstance(value, _Array) else value
    return stored.reshape(shape, order='F' if is_fortran else 'C')
