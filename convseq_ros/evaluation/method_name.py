# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How a method is asked for on a command line, and what that means."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import PurePath
import re

from convseq_ros.errors import ConfigError

_PATTERN = re.compile(
    r'(?:(?P<label>[\w.-]+)=)?(?P<kind>[a-z]+(?:-(?:forward|bow|vlad))?)(?:-k(?P<length>[0-9]+))?'
    r'(?::(?P<argument>.+?))?(?:@(?P<sequence>dynamic|single|k[0-9]+))?'
    r'(?P<options>(?:\+\w+=[^+]+)*)'
)


@dataclass(frozen=True, slots=True)
class MethodName:
    """
    A method as asked for: `[label=]kind[-kN][:argument][@sequence][+option=value]...`.

    Parameters
    ----------
    label : str
        Name in tables and folders.
    kind : str
        Row of the registry.
    argument : str
        Files of the method, as written.
    length : int or None
        Frames matched together: 0 for as many as the frames ask for, None for the method's own.
    options : mapping of str to str
        Options of the method and parameters of the core.

    """

    label: str
    kind: str
    argument: str = ''
    length: int | None = None
    options: Mapping[str, str] = field(default_factory=dict)


def parse_method(text: str) -> MethodName:
    """
    Return what a text such as `convseq-k10` or `net=scores:net.npy@dynamic` asks for.

    Raises
    ------
    ConfigError
        If it cannot be understood.

    """
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
    label = found['label'] or _label(kind, argument, found['length'], sequence, options)
    return MethodName(label, kind, argument, length, options)


def _label(
    kind: str, argument: str, length: str | None, sequence: str | None, options: Mapping[str, str]
) -> str:
    name = PurePath(argument.split(',')[0]).stem if argument else kind
    parts = [name, f'k{length}' if length else '', sequence or '', *options.values()]
    return re.sub(r'[^\w.-]+', '_', '-'.join(part for part in parts if part))
