# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Small valid pictures and recordings of every kind; hostile files are made from them."""

from pathlib import Path
import tempfile

import cv2
from mcap.writer import CompressionType
import numpy as np
from rosbags.rosbag2 import StoragePlugin

from bench.recordings import drive, write_mcap, write_ros1, write_ros2

_PICTURES: dict[str, tuple[str, list[int]]] = {
    'jpeg': ('.jpg', []),
    'progressive': ('.jpg', [cv2.IMWRITE_JPEG_PROGRESSIVE, 1]),
    'png': ('.png', []),
    'bmp': ('.bmp', []),
    'tiff': ('.tiff', []),
    'ppm': ('.ppm', []),
    'webp': ('.webp', [cv2.IMWRITE_WEBP_QUALITY, 60]),
}


def gray(number: int = 0) -> np.ndarray:
    """Return a noise image."""
    noise = np.random.default_rng(number).integers(0, 256, (48, 64), np.uint8)
    return np.asarray(cv2.GaussianBlur(noise, (5, 5), 1.0))


def pictures() -> dict[str, bytes]:
    """Return a file of every image format, by name."""
    colour = np.dstack([gray(0), gray(1), gray(2)])
    return {
        name: cv2.imencode(suffix, colour, options)[1].tobytes()
        for name, (suffix, options) in _PICTURES.items()
    }


def recordings() -> dict[str, bytes]:
    """Return a recording of every kind that is a single file, by its name."""
    rows = drive(map(gray, range(4)))
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        for kind in CompressionType:
            write_mcap(folder / f'{kind.name}.mcap', rows, kind)
        write_mcap(folder / 'loose.mcap', rows, use_chunking=False)
        write_ros1(folder / 'drive.bag', rows)
        database = write_ros2(folder / 'db3', rows, StoragePlugin.SQLITE3) / 'db3.db3'
        files = *folder.glob('*.*'), database
        return {path.name: path.read_bytes() for path in files}
