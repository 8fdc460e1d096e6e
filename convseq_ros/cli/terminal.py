# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a person at a terminal sees."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
import sys
from typing import TypeVar

Item = TypeVar('Item')


def progress(items: Iterable[Item], total: int, what: str, unit: str = 'frames') -> Iterator[Item]:
    """Yield the items; a terminal shows how far, how fast and how long still."""
    if not sys.stderr.isatty():
        yield from items
        return
    try:
        from tqdm import tqdm
    except ImportError:
        yield from items
        return
    yield from tqdm(items, what, total, unit=f' {unit}', dynamic_ncols=True)


def warn(line: str) -> None:
    """Print a warning on standard error."""
    print(f'warning: {line}', file=sys.stderr)


def of_map(path: Path) -> Callable[[Sequence[int]], Iterable[int]]:
    """Return what shows how far a map is written."""
    return lambda steps: progress(steps, len(steps), path.name, '64 places')


def printable(text: str) -> str:
    """Return a stranger's words without what is more than text to a terminal."""
    return ''.join(one if one.isprintable() else '?' for one in text)
