# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Images and maps for the measurements: a drawn street, driven by day and again in the evening.

A map of any size is made of the day's descriptors, lap by lap. Each lap except one is another
street: pieces of the images are permuted, images are mixed, and random variation is added. The lap
in the middle is the street itself, so that the queries have a match. Other laps have the keypoints
of other images of the day.
"""

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from functools import cached_property
import json
import os
from pathlib import Path
import shutil
import sqlite3
import subprocess
import sys
from typing import Any

from convseq_ros.config import EncodingConfig, EVERY_FRAME, KeyframeConfig
from convseq_ros.core.encoding.descriptor import describe
from convseq_ros.core.encoding.first_stage import identity_of
from convseq_ros.core.encoding.keypoints import detect
from convseq_ros.core.encoding.regions import global_descriptor, unit
from convseq_ros.core.map.format import row_crc
from convseq_ros.core.map.image_coding import thumbnail
from convseq_ros.core.map.place import pack_cells, Picture, Place, unpack_cells
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.writer import MapWriter
from convseq_ros.io.regular_file import complete_or_absent
from convseq_ros.models.onnx_model import OnnxModel
from convseq_ros.simulation.drive import draw, Drive
from convseq_ros.simulation.street import Street
import cv2
import numpy as np
import numpy.typing as npt

_KEPT = KeyframeConfig()
_SPACING_NS = 100_000_000
_START_M = 3.4
_VARIATION = 0.1
_PIECES = 4
_LAP_SHIFT = 17  # images: how far the keypoints of a lap are off those of the lap before

Cells = npt.NDArray[np.float32]


def resident_mb() -> float:
    """Return the resident memory of this process."""
    pages = int(Path('/proc/self/statm').read_text(encoding='ascii').split()[1])
    return pages * os.sysconf('SC_PAGE_SIZE') / 1e6


@dataclass(frozen=True)
class Work:
    """The material, and the extent of a measurement."""

    folder: Path  # where the material is
    sizes: tuple[int, ...]  # of the maps, ascending
    threads: int = 1  # allowed for a part
    quick: bool = False  # whether only to check that everything runs

    def prepare(self, frames: int) -> None:
        """Draw both drives and write the maps; existing files are kept."""
        missing = [size for size in self.sizes if not self.map_path(size).exists()]
        if not missing and self.queries_path.exists():
            return
        evening = _evening(num_frames=frames)
        np.save(self.queries_path, np.array(_gray(frames, evening)))
        day = _gray(frames, Drive(num_frames=frames))
        cells = np.array([describe(gray).cells for gray in day])
        visible = np.ones(cells.shape[1:3], bool)
        kept = [
            (
                thumbnail(gray, _KEPT.thumbnail_width_px),
                detect(gray, visible, _KEPT.keypoints).tobytes(),
            )
            for gray in day
        ]
        for size in missing:
            _write(self.map_path(size), size, cells, kept)

    def largest(self, most: int) -> int:
        """Return the size of the largest map with at most `most` places."""
        return max(size for size in self.sizes if size <= most or size == self.sizes[0])

    @property
    def queries_path(self) -> Path:
        """The path of the second drive's images."""
        return self.folder / 'queries.npy'

    @cached_property
    def images(self) -> npt.NDArray[np.uint8]:
        """Gray images of the second drive, (n, 480, 640)."""
        return np.load(self.queries_path)

    def images_of(self, frames: int, speed_mps: float = 10.0) -> npt.NDArray[np.uint8]:
        """Return gray images (n, 480, 640) at 30 Hz of the second drive, drawn once."""
        path = self.folder / f'drive-{frames}-{speed_mps:g}.npy'
        if not path.exists():
            drive = _evening(num_frames=frames, frame_rate_hz=30, speed_mps=speed_mps)
            np.save(path, np.array(_gray(frames / 3, drive)))
        return np.load(path)

    def map_path(self, size: int) -> Path:
        """Return the path of the map of a size."""
        return self.folder / f'map-{size}.db'

    def keyframe_map(self, size: int) -> Path:
        """Return a map of a size that is marked as having at most 8 keyframes per second."""
        path = self.folder / f'map-{size}-keyframes.db'
        if not path.exists():
            shutil.copy(self.map_path(size), path)
            row = 'keyframes', json.dumps(KeyframeConfig(keyframe_interval_s=0.125).spacing)
            with closing(sqlite3.connect(path)) as database, database:
                change = 'UPDATE about SET value = ?, crc32 = ? WHERE name = ?'
                database.execute(change, (row[1], row_crc(row), row[0]))
        return path

    def model(self) -> Path:
        """Return a model of 10 MFLOP: random convolutions of a colour image; needs `onnx`."""
        path = self.folder / 'model.onnx'
        if not path.exists():
            script = Path(__file__).parents[1] / 'scripts' / 'make_onnx_model.py'
            subprocess.run([sys.executable, script, path, '--kind', 'random'], check=True)
        return path

    def model_map(self, size: int) -> Path:
        """Return a map with vectors of `model`; those of other streets are random."""
        path, frames = self.folder / f'map-{size}-model.db', len(self.images)
        if path.exists():
            return path
        model, plain = OnnxModel(self.model()), open_map(self.map_path(size))
        vectors = np.random.default_rng(size).standard_normal((size, model.numbers), np.float32)
        street_vectors = vectors[home(size, frames) :][:frames]
        day = _gray(frames, Drive(num_frames=frames))
        street_vectors[:] = [model(gray) for gray in day[: len(street_vectors)]]
        encoding = EncodingConfig(descriptor_model=identity_of(model))
        with MapWriter(path, encoding, EVERY_FRAME) as writer:
            for index, vector in enumerate(vectors):
                (picture,) = plain.pictures([index])
                writer.add(plain.places[index], picture, unit(vector).astype(np.float16))
        _mark_linked(path, size)
        return path


def read_into_file_cache(path: Path) -> None:
    """Read a file once, because the system may have evicted it from the cache."""
    with path.open('rb') as file:
        while file.read(1 << 24):
            pass


def truth(index: int, size: int, frames: int) -> int:
    """Return the reference that shows the same place as a query."""
    return home(size, frames) + index + round(_START_M)


def home(size: int, frames: int) -> int:
    """Return the first reference of the lap that is the street itself."""
    return (-(-size // frames) - 1) // 2 * frames


def _evening(**how: Any) -> Drive:
    return Drive(start_m=_START_M, lane_offset_m=-0.5, light='evening', seed=5, **how)


def _gray(length_m: float, drive: Drive) -> list[npt.NDArray[np.uint8]]:
    """Return the images of a drive along a street of such a length, and some metres more."""
    street = Street(length_m=length_m + 60, seed=7)
    return [cv2.cvtColor(shot.image, cv2.COLOR_BGR2GRAY) for shot in draw(street, drive)]


def _write(path: Path, size: int, cells: Cells, kept: list[tuple[bytes, bytes]]) -> None:
    """Write a map of varied cells, and of what is kept of the day's images besides."""
    count = len(kept)
    with complete_or_absent(path) as part:
        with MapWriter(part, EncodingConfig(), EVERY_FRAME) as writer:
            for index, packed in enumerate(_laps(size, cells)):
                place = Place(index * _SPACING_NS, f'{index:06d}.png')
                shift = _LAP_SHIFT * ((index - home(size, count)) // count)
                shown, _ = kept[index % count]
                _, keypoints = kept[(index + shift) % count]
                picture = Picture(packed, shown, keypoints)
                writer.add(place, picture, global_descriptor(unpack_cells(packed)))
        _mark_linked(part, size)


def _mark_linked(path: Path, size: int) -> None:
    """Mark all places as without links; otherwise a node would search links for all places."""
    with closing(sqlite3.connect(path)) as database, database:
        rows = ((place, *(None,) * 5) for place in range(size))
        add = 'INSERT INTO links VALUES (?, ?, ?, ?, ?, ?, ?)'
        database.executemany(add, ((*row, row_crc(row)) for row in rows))


def _laps(size: int, cells: Cells) -> Iterator[npt.NDArray[np.float16]]:
    rng = np.random.default_rng(size)
    count = len(cells)
    for start in range(0, size, count):
        street = cells if start == home(size, count) else _varied(cells, rng)
        yield from pack_cells(street[: size - start])


def _varied(cells: Cells, rng: np.random.Generator) -> Cells:
    """Return the descriptors of another street: pieces are permuted, images are mixed."""
    first, second = (
        np.roll(_cut_up(cells, rng), rng.integers(1, len(cells)), axis=0) for _ in range(2)
    )
    share = np.float32(rng.uniform(0.3, 0.7))
    noise = rng.standard_normal(cells.shape, np.float32)
    return (share * first + (1 - share) * second) * np.abs(1 + _VARIATION * noise)


def _cut_up(cells: Cells, rng: np.random.Generator) -> Cells:
    """Return images with their 16 pieces permuted, in the same way for all images."""
    count, rows, columns, bins = cells.shape
    shape = count, _PIECES, rows // _PIECES, _PIECES, columns // _PIECES, bins
    pieces = cells.reshape(shape).transpose(0, 1, 3, 2, 4, 5)
    pieces = pieces.reshape(count, _PIECES**2, *pieces.shape[3:])
    moved = pieces[:, rng.permutation(_PIECES**2)]
    moved = moved.reshape(count, _PIECES, _PIECES, *pieces.shape[2:])
    return moved.transpose(0, 1, 3, 2, 4, 5).reshape(cells.shape)
