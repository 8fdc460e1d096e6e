# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Training-free visual place recognition and loop closure on a robot's CPU.

The public face is six names, each loaded when it is used first:

>>> from convseq_ros import build_map, Config, Frame, Match, open_map, PlaceRecognizer
>>> build_map([Frame(stamp_ns, gray) for stamp_ns, gray in first_drive], 'map.db')
>>> recognizer = PlaceRecognizer(open_map('map.db'), Config())
>>> for stamp_ns, gray in second_drive:
...     match: Match = recognizer.process(Frame(stamp_ns, gray))
...     print(match.reason, match.accepted and match.accepted.reference_index)

Stamps are integer nanoseconds; images are uint8 arrays of shape (height, width).
"""

from importlib import import_module
from typing import Any

__version__ = '1.0.0'
__all__ = ['Config', 'Frame', 'Match', 'PlaceRecognizer', 'build_map', 'open_map']

_HOMES = {
    'Config': 'config',
    'Frame': 'core.types',
    'Match': 'core.types',
    'PlaceRecognizer': 'core.recognizer',
    'build_map': 'app.map_builder',
    'open_map': 'core.map.reader',
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(import_module(f'{__name__}.{_HOMES[name]}'), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
