# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A parameter: a field of a dataclass with bounds, a unit and one sentence that explains it."""

import argparse
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, fields
import difflib
import math
from numbers import Integral, Real
from typing import Any

from convseq_ros.config.arguments import local
from convseq_ros.errors import ConfigError

Value = bool | int | float | str
_NUMBERS = {int: Integral, float: Real}


def parameter(default: Value, doc: str, **about: Any) -> Any:
    """Declare a parameter; `about` sets further fields of `Parameter`."""
    return field(default=default, metadata={'doc': doc, **about})


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter, as the node and the commands declare it and the documents list it."""

    name: str
    type: type
    default: Value
    doc: str
    unit: str = ''
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    dynamic: bool = False  # whether it may change while a node runs
    is_path: bool = False  # whether it is the name of a file
    is_frame: bool = False  # whether it is the name of a TF frame

    def check(self, value: object) -> Value:
        """Return the value in this type, 1 as 1.0; ConfigError if wrong or out of bounds."""
        kind = _NUMBERS.get(self.type)
        if kind and isinstance(value, kind) and not isinstance(value, bool):
            with suppress(OverflowError):  # an integer may be beyond all floats
                value = self.type(value)  # also of NumPy
        if type(value) is not self.type:
            raise ConfigError(
                f'{self.name}: expected {self.type.__name__}, got {value!r}; '
                f'the default is {self.default!r}'
            )
        if self.choices and value not in self.choices:
            raise ConfigError(f'{self.name}: {value!r} is not one of {", ".join(self.choices)}')
        if isinstance(value, float) and not math.isfinite(value):
            raise ConfigError(f'{self.name}: {value!r} is not a finite number')
        if self.is_frame:
            value = str(value).removeprefix('/')  # of ROS 1; TF 2 has none
            if not value.strip():
                raise ConfigError(
                    f'{self.name}: names no TF frame; the default is {self.default!r}'
                )
        if self.is_path:
            return local(str(value))
        too_low = self.low is not None and value < self.low  # type: ignore[operator]
        too_high = self.high is not None and value > self.high  # type: ignore[operator]
        if too_low or too_high:
            raise ConfigError(f'{self.name}: {value!r} is outside {self.bounds}')
        return value  # type: ignore[return-value]

    @property
    def bounds(self) -> str:
        """The allowed values in words, such as `0 .. 25`."""
        if self.choices:
            return ' | '.join(self.choices)
        low = '' if self.low is None else f'{self.low:g}'
        high = '' if self.high is None else f'{self.high:g}'
        return f'{low} .. {high}' if low or high else ''

    def parse(self, text: str) -> Value:
        """Return the value that a person wrote on a command line."""
        if self.type is bool:
            if text.lower() not in ('true', 'false'):
                raise ConfigError(f'{self.name}: expected true or false, got {text!r}')
            return text.lower() == 'true'
        try:
            value: Value = self.type(text)
        except ValueError:
            raise ConfigError(
                f'{self.name}: expected {self.type.__name__}, got {text!r}'
            ) from None
        return self.check(value)


def parameters(group: type | Any) -> Iterator[Parameter]:
    """Yield the parameters of a group (class or instance), in order."""
    for item in fields(group):
        if about := item.metadata:
            yield Parameter(item.name, item.type, item.default, **about)  # type: ignore[arg-type]


def add_parameters(
    parser: argparse.ArgumentParser, title: str, declared: Iterable[Parameter]
) -> None:
    """Add an option for each parameter, such as `--max-length`; unset ones stay absent."""
    group = parser.add_argument_group(title)
    for item in declared:
        unit = f' [{item.unit}]' if item.unit else ''
        default = f'default {item.default}' if item.default != '' else 'empty by default'
        about = f'{item.bounds}{unit}; {default}' if item.bounds else default
        group.add_argument(
            '--' + item.name.replace('_', '-'),
            dest=item.name,
            metavar='VALUE',
            default=argparse.SUPPRESS,
            help=f'{item.doc} ({about})'.replace('%', '%%'),
        )


def given(chosen: argparse.Namespace, declared: Iterable[Parameter]) -> dict[str, Value]:
    """Return the parameters that were given as options, parsed and checked."""
    return {
        item.name: item.parse(getattr(chosen, item.name))
        for item in declared
        if hasattr(chosen, item.name)
    }


class Checked:
    """Bounds are checked whenever a group is made, so an instance is always valid."""

    __slots__ = ()

    def __post_init__(self) -> None:
        for item in parameters(self):
            object.__setattr__(self, item.name, item.check(getattr(self, item.name)))


def refuse_unknown(
    names: Iterable[str], allowed: Iterable[str], what: str = 'unknown parameter'
) -> None:
    """Raise a ConfigError that names the first unknown parameter and the most similar one."""
    allowed = list(allowed)
    for name in names:
        if name not in allowed:
            near = difflib.get_close_matches(str(name), allowed, n=1)  # YAML allows 5 as a name
            advice = f'did you mean {near[0]}?' if near else f'known: {", ".join(allowed)}'
            raise ConfigError(f'{what} {name!r}; {advice}')
