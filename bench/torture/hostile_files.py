# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Hostile files: bombs, damage, and what is no file, given to the commands that read them."""

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
import random
import tempfile

from convseq_ros.cli import main as convseq
from convseq_ros.config import Config
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.sources import open_source
import cv2
import numpy as np

from bench.torture.attack import Try
from bench.torture.bombs import BOMBS
from bench.torture.corpus import pictures, put, recordings
from bench.torture.forked import problem_of
from bench.torture.spoil import spoil

ABOUT = (
    'Pictures, recordings and folders that are bombs (JPEG, PNG, TIFF, chunks of zstd, shared '
    'pages of SQLite, endless views, aliases, pipes, devices), cut, flipped or spliced; read by '
    '`build-map`'
)
ORACLE = 'exit 0 or 1, no traceback, within 5 s, below 1 GB'
COUNT, PORTION, SHORT, SEED = 5_000, 100, 8, 16
_SHARE_OF_BOMBS = 0.4


def run(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Make a file and have it read, in a fork, again and again."""
    draw = random.Random(seed)
    cv2.setNumThreads(1)
    # Compiled before the forks, and so but once.
    describe(np.zeros((64, 64), np.uint8), Config().encoding)
    with tempfile.TemporaryDirectory(dir=folder) as place:
        _read_whole(Path(place))
    makers = _damaged()
    for number in range(count):
        own = random.Random(draw.getrandbits(64))
        name = own.choice(list(BOMBS)) if own.random() < _SHARE_OF_BOMBS else 'damaged'
        with tempfile.TemporaryDirectory(dir=folder) as place:
            if name == 'damaged':
                kind = own.choice(list(makers))
                path, name = makers[kind](Path(place), own), f'damaged {kind}'
            else:
                path = BOMBS[name](Path(place), own)
            yield Try(f'{number} ({name})', problem_of(lambda path=path: _read(path)))


def _read_whole(folder: Path) -> None:
    """Import all that reading needs, and see that what is whole can be read."""
    for kind in recordings():
        assert len(list(open_source(put(kind, folder)))) > 1, kind


def _read(path: Path) -> int:
    return convseq(['build-map', str(path), str(path.parent / 'map.db'), '--image-size-px', '64'])


def _damaged() -> dict[str, Callable[[Path, random.Random], Path]]:
    def picture(kind: str, place: Path, draw: random.Random) -> Path:
        suffix, data = pictures()[kind]
        (place / 'pictures').mkdir()
        (place / 'pictures' / f'1{suffix}').write_bytes(spoil(data, draw))
        return place / 'pictures'

    def recording(kind: str, place: Path, draw: random.Random) -> Path:
        path = put(kind, place)
        victim = draw.choice(sorted(path.iterdir())) if path.is_dir() else path
        victim.write_bytes(spoil(victim.read_bytes(), draw))
        return path

    return {kind: partial(picture, kind) for kind in pictures()} | {
        kind: partial(recording, kind) for kind in recordings()
    }
