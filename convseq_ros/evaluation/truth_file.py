# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Truth as people keep it: tables, VPR-Bench's .npy files, positions."""

from collections.abc import Callable, Mapping, Sequence
import csv
import io
import math
from pathlib import Path
import pickle  # nosec B403
import re
from typing import Any, BinaryIO

from convseq_ros.errors import one_line, SourceError
from convseq_ros.files import read_array, read_array_header, read_text
from convseq_ros.reading_config import AS_PICKLE, ReadingConfig
from convseq_ros.regular_file import refuse_irregular
import numpy as np
import numpy.typing as npt

Pairs = npt.NDArray[np.int64]


def read_pairs(
    path: Path,
    query_names: Sequence[str],
    reference_names: Sequence[str],
    first_index: int = 0,
    reading: ReadingConfig = ReadingConfig(),
) -> Pairs:
    """
    Return the pairs of a table, int64 (P, 2), or (P, 3) with the tolerance of each, from 0.

    It is a CSV table with a header. The first column is the query and the second the reference,
    each a frame number, counted from `first_index`, or a file name of those given in the order of
    the frames; several references stand in several rows, or in one cell with spaces between them.
    A column called `tolerance` holds for its row. SourceError if it cannot be read.
    """
    text = io.StringIO(read_text(path, 'a CSV table', reading), newline='')
    try:
        rows = [row for row in csv.reader(text) if any(cell.strip() for cell in row)]
    except csv.Error:
        raise SourceError(f'{path}: not a CSV table; check the file') from None
    header = [cell.strip().lower() for cell in rows[0]] if rows else []
    if len(header) < 2:
        raise SourceError(f'{path}: expected a header and the columns query, reference')
    own = header.index('tolerance') if 'tolerance' in header else None
    numbers = [_numbers(query_names, first_index), _numbers(reference_names, first_index)]
    pairs = []
    for line, row in enumerate(rows[1:], 2):
        try:
            query = numbers[0](row[0].strip())
            reach = [] if own is None else [int(row[own])]
            pairs += [[query, numbers[1](cell), *reach] for cell in row[1].split()]
        except (IndexError, ValueError, OverflowError):
            raise SourceError(
                f'{path}: line {line} ({",".join(row)[:80]}) names no frames; expected numbers or '
                'names of images'
            ) from None
    try:
        return np.array(pairs, np.int64).reshape(-1, 2 if own is None else 3)
    except OverflowError:
        raise SourceError(f'{path}: a number is no frame, it is too large') from None


def read_npy(
    path: Path, shape: tuple[int, int], reading: ReadingConfig = ReadingConfig()
) -> Pairs:
    """
    Return the pairs in a .npy file, int64 (P, 2); SourceError if it is none.

    It is VPR-Bench's array of rows (query, list of references); or a plain array: bool of shape
    (Q, R), which is `shape`, or integers of shape (P, 2). Object arrays are pickles, which can run
    any code when they are loaded the usual way: here only arrays, numbers, strings and lists are
    let through.
    """
    refuse_irregular(path)
    try:
        stored = _load(path, reading)
    except SourceError:
        raise
    except OSError as error:
        raise SourceError(f'{path}: {error.strerror}; check the path of the truth') from None
    except Exception as error:
        raise SourceError(f'{path}: not a readable .npy file ({one_line(error)})') from None
    if stored.dtype == np.bool_ and stored.ndim == 2:
        if stored.shape != shape:
            raise SourceError(
                f'{path}: a matrix of {stored.shape[0]} x {stored.shape[1]} for {shape[0]} '
                f'queries and {shape[1]} references; give the truth of these images'
            )
        return np.argwhere(stored)
    if stored.ndim != 2 or stored.shape[1] != 2:
        raise SourceError(
            f'{path}: an array of shape {stored.shape} is no truth; expected rows of query and '
            'references, or a bool matrix'
        )
    pairs: list[list[int]] = []
    try:
        for query, references in stored.tolist():
            own = references if isinstance(references, list) else [references]
            if len(pairs) + len(own) > shape[0] * shape[1]:
                raise SourceError(
                    f'{path}: has more pairs than there are of queries and references'
                )
            pairs += [[int(query), int(reference)] for reference in own]
        return np.array(pairs, np.int64).reshape(-1, 2)
    except (TypeError, ValueError, OverflowError):
        raise SourceError(f'{path}: its rows are not query and list of references') from None


def read_positions(
    path: Path, drive: str, count: int, reading: ReadingConfig = ReadingConfig()
) -> npt.NDArray[np.float64]:
    """
    Return where the frames of a drive, `query` or `reference`, were taken, (count, 3), metres.

    It is a CSV table with the columns x, y and perhaps z, one row for every frame, in order. If it
    has a column `drive`, only rows of this drive count. SourceError if it cannot be read, or its
    rows are not as many as the frames.
    """
    text = io.StringIO(read_text(path, 'a CSV table', reading), newline='')
    try:
        rows: list[Mapping[str, str]] = list(csv.DictReader(text))
        own = [row for row in rows if row.get('drive', drive) == drive]
        positions = [[float(row['x']), float(row['y']), float(row.get('z') or 0)] for row in own]
    except (csv.Error, KeyError, TypeError, ValueError):
        raise SourceError(
            f'{path}: expected a CSV table with the columns x, y, z in metres'
        ) from None
    if len(positions) != count:
        raise SourceError(
            f'{path}: {len(positions)} positions for {count} {drive} images; give one for each'
        )
    return np.array(positions).reshape(-1, 3)


def _numbers(names: Sequence[str], first_index: int) -> Callable[[str], int]:
    by_name = {name: index for index, name in enumerate(names)}
    by_name |= {Path(name).stem: index for index, name in enumerate(names)}

    def number(cell: str) -> int:
        try:
            return int(cell) - first_index
        except ValueError:
            return by_name[cell] if cell in by_name else int(float(cell)) - first_index

    return number


def _load(path: Path, reading: ReadingConfig) -> npt.NDArray[Any]:
    with path.open('rb') as file:
        shape, fortran, dtype = read_array_header(file)
        if not dtype.hasobject:
            return read_array(path, reading=reading)
        reading.refuse_file(path, path.stat().st_size, AS_PICKLE)
        return read_objects(file, shape, fortran)


# Arrays of objects in a pickle of a stranger. No name of a pickle leads to NumPy, whose own way to
# fill an array believes what it is told of its type, and then reads where there is nothing. The
# module of Python that reads pickles is used, not that in C, which takes the memory for a number
# of a name before it looks at the name.
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
    """Return an array of objects behind a .npy header; an exception of any kind if it is none."""
    found = _Unpickler(io.BytesIO(file.read()), encoding='latin1').load()
    if not isinstance(found, _Array) or len(found.values) != math.prod(shape):
        raise ValueError(f'holds no array of shape {shape}')
    stored = np.empty(len(found.values), object)
    for index, value in enumerate(found.values):
        stored[index] = value.values if isinstance(value, _Array) else value
    return stored.reshape(shape, order='F' if is_fortran else 'C')
