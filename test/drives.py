# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Drawn drives, which take long to draw: a machine draws each once, until the drawing changes."""

from collections.abc import Callable, Iterable
import contextlib
import functools
import hashlib
import os
from pathlib import Path
import pickle

from convseq_ros import simulation
from convseq_ros.core import types
from convseq_ros.simulation.drive import draw, Drive, Road, Shot
import cv2
import numpy as np

KEPT = Path(__file__).resolve().parents[1] / '.pytest_cache' / 'drives'
WEEK_S = 7 * 86_400  # after which a drive that nobody asks for goes


@functools.cache
def _drawing() -> bytes:
    """Return a digest of all that decides what a drive looks like."""
    sources = [*Path(simulation.__file__).parent.glob('*.py'), Path(types.__file__)]
    versions = f'{cv2.__version__} {np.__version__}'.encode()
    texts = [path.read_bytes() for path in sorted(sources)]
    return hashlib.sha256(b'\0'.join([versions, *texts])).digest()


def kept(make: Callable[[], Iterable[Shot]], *what: object) -> list[Shot]:
    """Return what is made, which has this description and no other."""
    path = KEPT / f'{hashlib.sha256(_drawing() + repr(what).encode()).hexdigest()}.pickle'
    if path.exists():
        path.touch()
        return pickle.loads(path.read_bytes())
    shots, part = [*make()], path.with_suffix(f'.{os.getpid()}.pickle')
    KEPT.mkdir(parents=True, exist_ok=True)
    part.write_bytes(pickle.dumps(shots))
    part.replace(path)
    for one in KEPT.iterdir():
        with contextlib.suppress(FileNotFoundError):  # another process forgets, too
            if path.stat().st_mtime - one.stat().st_mtime > WEEK_S:
                one.unlink()
    return shots


def shots_of(road: Road, drive: Drive) -> list[Shot]:
    """Return the shots of a drive."""
    return kept(lambda: draw(road, drive), road, drive)
