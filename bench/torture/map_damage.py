# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Damages maps like a bad disk: flipped bits, lost sectors, truncated files."""

from collections.abc import Iterator
from pathlib import Path
import random

from convseq_ros.core.map.reader import MapReader, open_map
from convseq_ros.core.map.writer import save_map

from bench.torture.attack import Try
from bench.torture.maps import add_one, drawn, links_hold, problem_of_use

ABOUT = (
    'In a map of 60 places and 40 links one bit flips (of ten tries six), 512 bytes are zeros or '
    'those of elsewhere (three), or the end is cut off (one); it is read, and added to'
)
ORACLE = (
    'it is refused with one line within 5 s, or all that it answers is what it was, but for links '
    'that it says in one line are damaged'
)
COUNT, PORTION, SHORT, SEED = 5_000, 500, 40, 16
_PLACES, _LINKS, _SECTOR = 60, 40, 512


def run(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Damage a map in many ways."""
    path, draw = folder / 'map.db', random.Random(seed)
    save_map(drawn(_PLACES), path)
    content, answers = path.read_bytes(), _answers(path)
    for number in range(count):
        for beside in folder.iterdir():
            beside.unlink()
        name, damaged = _damaged(content, draw)
        path.write_bytes(damaged)
        yield Try(f'{number}: {name}', problem_of_use(path, lambda: _used(path, answers)))


def _damaged(content: bytes, draw: random.Random) -> tuple[str, bytes]:
    damaged, position = bytearray(content), draw.randrange(len(content))
    kind = draw.choice(['flip'] * 6 + ['zeros', 'elsewhere', 'elsewhere', 'cut'])
    if kind == 'flip':
        damaged[position] ^= 1 << draw.randrange(8)
    elif kind == 'cut':
        del damaged[position:]
    else:
        start, other = (draw.randrange(len(content) // _SECTOR) * _SECTOR for _ in range(2))
        new = bytes(_SECTOR) if kind == 'zeros' else content[other : other + _SECTOR]
        damaged[start : start + _SECTOR] = new
    return f'{kind} at {position}', bytes(damaged)


def _answers(path: Path) -> object:
    """Return all answers of a map, in a form that can be compared."""
    reader = MapReader(path)
    reference_map = reader.reference_map()
    pictures = reference_map.pictures(range(len(reference_map)), with_images=True)
    return (
        reader.settings,
        reference_map.sessions,
        [*reference_map.places],
        reference_map.global_descriptors.tobytes(),
        [(one.packed.tobytes(), one.thumbnail, one.image) for one in pictures],
    )


def _used(path: Path, answers: object) -> str:
    if _answers(path) != answers:
        return 'answers otherwise'
    opened = open_map(path)
    if not links_hold(opened) or (len(opened.links) < _LINKS and not opened.problem):
        return f'has {len(opened.links)} links, and says {opened.problem!r}'
    return add_one(path, _PLACES)
