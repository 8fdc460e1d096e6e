# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a parameter is: a field of a dataclass with bounds, a unit and one sentence."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, fields
import difflib
import math
from typing import Any

from convseq_ros.errors import ConfigError

Value = bool | int | float | str

# What parameters were called before; such names are refused with the one that they have now.
RENAMED = {'remove_layout': 'subtract_background', 'speed_search': 'velocity_search'}


def parameter(
    default: Value,
    doc: str,
    *,
    unit: str = '',
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] = (),
    dynamic: bool = False,
) -> Any:
    """Declare one parameter; `dynamic` ones may change while a node runs."""
    metadata = {
        'doc': doc,
        'unit': unit,
        'low': low,
        'high': high,
        'choices': choices,
        'dynamic': dynamic,
    }
    return field(default=default, metadata=metadata)


@dataclass(frozen=True, slots=True)
class Parameter:
    """What is known about one parameter, for whoever declares or documents it."""

    name: str
    type: type
    default: Value
    doc: str
    unit: str
    low: float | None
    high: float | None
    choices: tuple[str, ...]
    dynamic: bool

    def check(self, value: object) -> Value:
        """
        Return the value in this parameter's type.

        Raises
        ------
        ConfigError
            If the type is wrong or the value is out of bounds; whole numbers are taken as floats.

        """
        if self.type is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        if type(value) is not self.type:
            raise ConfigError(
                f'{self.name}: expected {self.type.__name__}, got {value!r}; '
                f'the default is {self.default!r}'
            )
        if self.choices and value not in self.choices:
            raise ConfigError(f'{self.name}: {value!r} is not one of {", ".join(self.choices)}')
        if isinstance(value, float) and not math.isfinite(value):
            raise ConfigError(f'{self.name}: {value!r} is not a finite number')
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
        yield Parameter(item.name, item.type, item.default, **item.metadata)  # type: ignore[arg-type]


class Checked:
    """Bounds are checked whenever a group is made, so an instance is always valid."""

    __slots__ = ()

    def __post_init__(self) -> None:
        for item in parameters(self):
            object.__setattr__(self, item.name, item.check(getattr(self, item.name)))


def refuse_unknown(names: Iterable[str], known: Iterable[str]) -> None:
    """
    Refuse names that no parameter has.

    Raises
    ------
    ConfigError
        Naming the first unknown one and the nearest known one.

    """
    known = list(known)
    for name in names:
        refuse_renamed(name)
        if name not in known:
            near = difflib.get_close_matches(str(name), known, n=1)  # in YAML, 5 is a name
            advice = f'did you mean {near[0]}?' if near else f'known: {", ".join(known)}'
            raise ConfigError(f'unknown parameter {name!r}; {advice}')


def refuse_renamed(name: str) -> None:
    """Refuse a name that a parameter had before: ConfigError with the one that it has now."""
    if name in RENAMED:
        raise ConfigError(f'parameter {name!r} is now called {RENAMED[name]!r}; use that name')
