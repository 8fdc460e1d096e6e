# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How a method is asked for on a command line, and what that means."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import PurePath
import re

from convseq_ros.errors import ConfigError

_PATTERN = re.compile(
    r'(?:(?P<label>[\w.-]+)=)?(?P<kind>[a-z]+(?:-[a-z]+)?)(?:-k(?P<length>[0-9]+))?'
    r'(?::(?P<argument>.+?))?(?:@(?P<sequence>dynamic|single|k[0-9]+))?'
    r'(?P<options>(?:\+\w+=[^+]+)*)'
)


@dataclass(frozen=True, slots=True)
class MethodName:
    """A method as asked for: `[label=]kind[-kN][:argument][@sequence][+option=value]...`."""

    label: str  # in tables and folders
    kind: str  # row of the registry
    argument: str = ''  # files of the method, as written
    length: int | None = None  # k: 0 for as many as the frames ask for, None for its own
    options: Mapping[str, str] = field(default_factory=dict)  # its own, and core parameters


def parse_method(text: str) -> MethodName:
    """Return what `convseq-k10` or `net=scores:net.npy@dynamic` means; ConfigError if unclear."""
    found = _PATTERN.fullmatch(text)
    if not found:
        raise ConfigError(
            f'method {text!r}: expected [label=]kind[:file][@single|@dynamic|@kN][+option=value], '
            'such as convseq, convseq-k10 or net=scores:net.npy@dynamic'
        )
    kind, argument, sequence = found['kind'], found['argument'] or '', found['sequence']
    options = dict(part.split('=', 1) for part in found['options'].split('+')[1:])
    length = int(found['length']) if found['length'] else None
    if sequence:
        length = {'dynamic': 0, 'single': 1}.get(sequence)
        length = int(sequence[1:]) if length is None else length
    label = found['label']
    if not label:
        name = PurePath(argument.split(',')[0]).stem if argument else kind
        k = f'k{found["length"]}' if found['length'] else ''
        parts = [name, k, sequence or '', *options.values()]
        label = re.sub(r'[^\w.-]+', '_', '-'.join(part for part in parts if part))
    return MethodName(label, kind, argument, length, options)
