# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How a method is requested: its name, the files and the options that it is given."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
import math
from pathlib import PurePath
import re
from typing import TypeVar

from convseq_ros.errors import ConfigError

Number = TypeVar('Number', int, float)
_PATTERN = re.compile(
    r'(?:(?P<label>\w[\w.-]*)=)?(?P<kind>[a-z]+(?:-[a-z]+)?)(?:-k(?P<length>[0-9]+))?'
    r'(?::(?P<argument>.+?))?(?:@(?P<sequence>dynamic|single|k[0-9]+))?'
    r'(?P<options>(?:\+\w+=[^+]+)*)'
)


@dataclass(frozen=True, slots=True)
class MethodName:
    """A method as requested: `[label=]kind[-kN][:argument][@sequence][+option=value]...`."""

    label: str  # for tables and folders
    kind: str  # key of `KINDS`
    argument: str = ''  # files of the method, as written
    length: int | None = None  # k: 0 for dynamic, None for the method's default
    options: Mapping[str, str] = field(default_factory=dict)  # and core parameters

    def number(
        self, kind: Callable[[str], Number], key: str, default: Number, least: float = -math.inf
    ) -> Number:
        """Return an option, a number of at least `least`; ConfigError for any other text."""
        text = self.options.get(key, str(default))
        try:
            number = kind(text)
        except ValueError:
            raise ConfigError(f'method {self.label}: {key} is not a number: {text!r}') from None
        if number < least:
            raise ConfigError(f'method {self.label}: {key} is {text}; give at least {least:g}')
        return number


def parse_method(text: str) -> MethodName:
    """Parse a text like `convseq-k10` or `net=scores:net.npy@dynamic`; ConfigError if unclear."""
    groups = _PATTERN.fullmatch(text)
    if not groups:
        raise ConfigError(
            f'method {text!r}: expected [label=]kind[:file][@single|@dynamic|@kN][+option=value], '
            'for example convseq, convseq-k10 or net=scores:net.npy@dynamic'
        )
    kind, argument, sequence = groups['kind'], groups['argument'] or '', groups['sequence']
    options = dict(part.split('=', 1) for part in groups['options'].split('+')[1:])
    length = int(groups['length']) if groups['length'] else None
    if sequence:
        length = {'dynamic': 0, 'single': 1}.get(sequence)
        length = int(sequence[1:]) if length is None else length
    label = groups['label']
    if not label:
        name = PurePath(argument.split(',')[0]).stem if argument else kind
        k = f'k{groups["length"]}' if groups['length'] else ''
        parts = [name, k, sequence or '', *options.values()]
        label = re.sub(r'[^\w.-]+', '_', '-'.join(part for part in parts if part))
    return MethodName(label, kind, argument, length, options)
