# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Drawn drives, which take long to draw: a machine draws each once, until the drawing changes."""

from collections.abc import Callable, Iterable
import contextlib
from dataclasses import asdict
import functools
import hashlib
import json
import os
from pathlib import Path
from typing import Any

from convseq_ros import simulation
from convseq_ros.core import types
from convseq_ros.core.types import Camera, Pose
from convseq_ros.simulation.drive import draw, Drive, Road, Shot
from convseq_ros.simulation.street import Street
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
    path = KEPT / f'{hashlib.sha256(_drawing() + repr(what).encode()).hexdigest()}.npz'
    if path.exists():
        path.touch()
        return _read(path)
    shots, part = [*make()], path.with_suffix(f'.{os.getpid()}.npz')
    KEPT.mkdir(parents=True, exist_ok=True)
    _write(shots, part)
    part.replace(path)
    for one in KEPT.iterdir():
        with contextlib.suppress(FileNotFoundError):  # another process forgets, too
            if path.stat().st_mtime - one.stat().st_mtime > WEEK_S:
                one.unlink()
    return shots


def _write(shots: list[Shot], path: Path) -> None:
    """Write images as arrays, and the rest as JSON, whose numbers come back exactly."""
    images = {f'image_{index}': shot.image for index, shot in enumerate(shots)}
    rest = [
        {name: value for name, value in asdict(shot).items() if name != 'image'} for shot in shots
    ]
    np.savez(path, rest=np.array(json.dumps(rest)), **images)


def _read(path: Path) -> list[Shot]:
    """Return what `_write` wrote."""
    convert = {'pose': _pose, 'odometry': _pose, 'camera': _camera}
    with np.load(path, allow_pickle=False) as stored:
        return [
            Shot(
                **one | {name: made(one[name]) for name, made in convert.items()},
                image=stored[f'image_{index}'],
            )
            for index, one in enumerate(json.loads(str(stored['rest'])))
        ]


def _pose(stored: dict[str, Any] | None) -> Pose | None:
    return stored and Pose(tuple(stored['position']), tuple(stored['orientation']))


def _camera(stored: dict[str, Any] | None) -> Camera | None:
    own = {'distortion': tuple, 'mount': _pose}
    return stored and Camera(**stored | {name: read(stored[name]) for name, read in own.items()})


def shots_of(road: Road, drive: Drive) -> list[Shot]:
    """Return the shots of a drive."""
    return kept(lambda: draw(road, drive), road, drive)


def small_drive() -> list[Shot]:
    """Return the shots of a drive of 30 small pictures, a metre apart, down a street."""
    return shots_of(Street(60.0, seed=3), Drive(num_frames=30, width_px=160, height_px=120))
