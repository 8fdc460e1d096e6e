# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads small files of unknown origin: the declared size is checked before anything is read."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, MISSING
from functools import partial
from pathlib import Path
from typing import Any, get_args, get_origin, TypeVar

from convseq_ros.config.parameter import refuse_unknown
from convseq_ros.config.reading_config import AS_TEXT, AS_YAML, ReadingConfig
from convseq_ros.errors import ConfigError, ConvseqError, load, one_line, SourceError
from convseq_ros.io.regular_file import read_bytes, refuse_irregular
import numpy as np
import numpy.typing as npt

Record = TypeVar('Record')
_HEAD_BYTES = 100


def read_yaml(path: Path, reading: ReadingConfig = ReadingConfig()) -> Mapping[str, Any]:
    """
    Return the mapping in a YAML file; or ConfigError.

    Aliases are refused, which ROS does not read either: with them a few lines can expand to
    terabytes. So are keys that a mapping has twice.
    """
    yaml = load('yaml', f'{path}:', ConfigError)
    try:
        data = read_bytes(path, 'a YAML file', partial(_refuse_no_yaml, reading))
        loader = yaml.SafeLoader(data.decode('utf-8'))
        content = _plain(loader, path)
        repr(content)  # no message could tell an integer of thousands of digits
    except SourceError as error:
        raise ConfigError(str(error)) from None
    except RecursionError:
        raise ConfigError(f'{path}: not YAML that can be read: nested too deeply') from None
    except (ValueError, ArithmeticError, LookupError, TypeError, yaml.YAMLError) as error:
        raise ConfigError(f'{path}: not YAML ({one_line(error)})') from None
    if not isinstance(content, Mapping):
        raise ConfigError(f'{path}: the file is not a list of `key: value`')
    return content


def _refuse_no_yaml(reading: ReadingConfig, path: Path, size_bytes: int) -> None:
    with path.open('rb') as file:
        if b'\0' in file.read(_HEAD_BYTES):
            raise SourceError(f'{path}: is no text, but like a map or a picture; give a YAML file')
    reading.refuse_file(path, size_bytes, AS_YAML)


def _plain(loader: Any, path: Path) -> Any:
    """Return the content that a loader reads; ConfigError if it has an alias or a key twice."""
    import yaml

    compose = loader.compose_node

    def compose_node(parent: Any, index: Any) -> Any:
        if loader.check_event(yaml.AliasEvent):
            raise ConfigError(f'{path}: has an alias, such as *name; write its content instead')
        node = compose(parent, index)
        pairs = node.value if isinstance(node, yaml.MappingNode) else []
        keys = Counter(key.value for key, _ in pairs if isinstance(key, yaml.ScalarNode))
        for key, count in keys.most_common(1):
            if count > 1:
                raise ConfigError(f'{path}: has {key[:40]!r} {count} times; leave one')
        return node

    loader.compose_node = compose_node
    try:
        return loader.get_single_data()
    finally:
        loader.dispose()


def make_record(kind: type[Record], content: Any, where: str, base: Path = Path()) -> Record:
    """
    Return a dataclass with the values of a mapping; relative paths start at `base`.

    ConfigError if a value is missing, does not suit its field, or has no field.
    """
    if not isinstance(content, Mapping):
        raise ConfigError(f'{where} is not a list of `key: value`')
    declared = {item.name: item for item in fields(kind)}  # type: ignore[arg-type]
    refuse_unknown(content, declared, f'{where}: unknown key')
    for name, item in declared.items():
        if item.default is MISSING and item.default_factory is MISSING and name not in content:
            raise ConfigError(f'{where}: says no {name}; add it')
    values = {
        name: _suited(declared[name].type, value, f'{where}: {name}', base)
        for name, value in content.items()
    }
    try:
        return kind(**values)
    except ConvseqError as error:
        raise ConfigError(f'{where}: {error}') from None


def _suited(kind: Any, value: Any, where: str, base: Path) -> Any:
    """Return a value in the type of a field; ConfigError if its type does not suit."""
    for option in get_args(kind) or (kind,):
        if is_dataclass(option):
            return make_record(option, value, where, base)  # type: ignore[arg-type]
        if option is Path:
            if get_origin(kind) is not Mapping:
                return base / str(value)
            if isinstance(value, Mapping):
                return {str(name): base / str(file) for name, file in value.items()}
    if kind is str:
        return ' '.join(str(value).split())
    if kind is bool and isinstance(value, bool):
        return value
    number = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 2**62
    if not number or kind not in (int, float) or kind(value) != value:
        expected = 'true or false' if kind is bool else 'a number of the right kind'
        raise ConfigError(f'{where}: {value!r} is not {expected}')
    return kind(value)


def read_array(path: Path, reading: ReadingConfig = ReadingConfig()) -> npt.NDArray[Any]:
    """Return the array of plain numbers in a .npy file; SourceError if it is too large."""
    refuse_irregular(path)
    try:
        stored = np.lib.format.open_memmap(path, mode='r')  # which allocates nothing
        reading.refuse_file(path, stored.nbytes)
        return np.array(stored)
    except OSError as error:
        raise SourceError(f'{path}: {error.strerror or error}; check the path') from None
    except SourceError:
        raise
    except Exception as error:
        raise SourceError(
            f'{path}: not a file of plain numbers ({one_line(error)}); save it again'
        ) from None


def read_text(
    path: Path, what: str, reading: ReadingConfig = ReadingConfig(), cost: int = AS_TEXT
) -> str:
    """Return the content of a text file; SourceError as in `read_bytes`, or if it is not text."""
    try:
        return read_bytes(path, what, partial(reading.refuse_file, cost=cost)).decode('utf-8-sig')
    except UnicodeDecodeError:
        raise SourceError(f'{path}: not a text file; give {what}') from None
