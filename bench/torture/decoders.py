# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""All decoders of foreign data, each with small valid inputs."""

from collections import deque
from collections.abc import Callable
from pathlib import Path
import sqlite3
import tempfile
from typing import Any, NamedTuple

from convseq_ros.app.result_row import COLUMNS
from convseq_ros.cli.parameter_file import read_parameter_file
from convseq_ros.config import Config, EncodingConfig
from convseq_ros.core.encoding.mask import masked
from convseq_ros.core.map.writer import save_map
from convseq_ros.evaluation.data_set import read_data_set
from convseq_ros.evaluation.truth import read_pairs, read_positions
from convseq_ros.io.mask_file import read_mask
from convseq_ros.io.results import read_results
from convseq_ros.sources import open_source
from convseq_ros.sources.camera_info import camera_from_info, read_camera_file
from convseq_ros.sources.images import message_pixels, picture_pixels
from convseq_ros.sources.pose_file import read_pose_file
from convseq_ros.sources.pose_track import pose_from_message
from convseq_ros.sources.raw_message import RawMessage
from convseq_ros.sources.topics import decode
import cv2
from mcap.writer import CompressionType
import numpy as np
from rosbags.rosbag2 import StoragePlugin

from bench import recordings
from bench.torture.maps import answers, drawn

_SMALLEST_PAGE_BYTES = 512  # of SQLite: a small map has a large share of structure


_PICTURES: dict[str, tuple[str, list[int]]] = {
    'jpeg': ('.jpg', []),
    'progressive': ('.jpg', [cv2.IMWRITE_JPEG_PROGRESSIVE, 1]),
    'png': ('.png', []),
    'bmp': ('.bmp', []),
    'tiff': ('.tiff', []),
    'ppm': ('.ppm', []),
    'webp': ('.webp', [cv2.IMWRITE_WEBP_QUALITY, 60]),
}


class Decoder(NamedTuple):
    """A decoder: valid samples, and a function that decodes bytes, given an empty folder."""

    samples: list[bytes]
    decode: Callable[[bytes, Path], object]


def decoders() -> dict[str, Decoder]:
    """Return every decoder, by name."""
    pictures = _pictures()
    by_name = {
        f'picture {kind}': Decoder([data], lambda given, _: picture_pixels(given))
        for kind, data in pictures.items()
    }
    by_name |= {
        f'recording {name}': Decoder(
            [data], _in_file(name, lambda path: deque(open_source(path), 0))
        )
        for name, data in _recordings().items()
    }
    by_name |= {
        f'message {message.__msgtype__.split("/")[-1]}': _message(message, read)
        for message, read in (
            (recordings.image(recordings.gray()), message_pixels),
            (recordings.compressed(recordings.gray(), suffix='.jpg', name='jpeg'), message_pixels),
            (recordings.camera_info(), lambda message: camera_from_info(decode(message))),
            (recordings.pose(), lambda message: pose_from_message(decode(message))),
        )
    }
    return by_name | {
        'map': Decoder([_map()], _in_file('map.db', answers)),
        'image mask': Decoder([pictures['png']], _in_file('m.png', _mask)),
        'parameter file': Decoder(
            [_of_ours('config/paper.yaml')], _in_file('my.yaml', read_parameter_file)
        ),
        'data set': Decoder(
            [_of_ours('convseq_ros/data_sets/corridor.yaml')],
            _in_file('set.yaml', lambda path: read_data_set(path, path.parent)),
        ),
        'camera file': Decoder(
            [_CAMERA, b'P0: 50 0 32 0 0 50 24 0 0 0 1 0\n'],
            _in_file('camera.yaml', lambda path: read_camera_file(path, 48, 64)),
        ),
        'pose file': Decoder(
            [b'# t x y z\n' + b'1.5 1 2 3 0 0 0 1\n' * 3, b'1 0 0 0 0 1 0 0 0 0 1 0\n' * 3],
            _in_file('poses.txt', lambda path: read_pose_file(path, 3)(0, 1_500_000_000)),
        ),
        'truth of pairs': Decoder(
            [b'query,reference,tolerance\n0,1 2,1\na.jpg,b.jpg,0\n'],
            _in_file('t.csv', lambda path: read_pairs(path, ['a.jpg'], ['b.jpg'])),
        ),
        'truth of positions': Decoder(
            [b'drive,x,y,z\nquery,1,2,3\nquery,2,3,4\n', b'image,lat,lon\na,-27.5,153\nb,9,8\n'],
            _in_file('t.csv', lambda path: read_positions(path, 'query', ['a', 'b'])),
        ),
        'result table': Decoder([_table()], _in_file('result.csv', read_results)),
    }


def _pictures() -> dict[str, bytes]:
    """Return a file of every image format, by name."""
    colour = np.dstack([recordings.gray(0), recordings.gray(1), recordings.gray(2)])
    return {
        name: cv2.imencode(suffix, colour, options)[1].tobytes()
        for name, (suffix, options) in _PICTURES.items()
    }


def _recordings() -> dict[str, bytes]:
    """Return a recording of every kind that is a single file, by its name."""
    rows = recordings.drive(map(recordings.gray, range(4)))
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        for kind in CompressionType:
            recordings.write_mcap(folder / f'{kind.name}.mcap', rows, kind)
        recordings.write_mcap(folder / 'loose.mcap', rows, use_chunking=False)
        recordings.write_ros1(folder / 'drive.bag', rows)
        database = recordings.write_ros2(folder / 'db3', rows, StoragePlugin.SQLITE3) / 'db3.db3'
        files = *folder.glob('*.*'), database
        return {path.name: path.read_bytes() for path in files}


def _of_ours(name: str) -> bytes:
    """Return the content of a file of the repository."""
    return Path(__file__).parents[2].joinpath(name).read_bytes()


def _message(message: Any, read: Callable[[RawMessage], object]) -> Decoder:
    kind = message.__msgtype__
    data = bytes(recordings.ROS2.serialize_cdr(message, kind))
    return Decoder([data], lambda given, _: read(RawMessage(0, kind, given)))


def _in_file(name: str, read: Callable[[Path], object]) -> Callable[[bytes, Path], object]:
    def decode(data: bytes, folder: Path) -> object:
        (folder / name).write_bytes(data)
        return read(folder / name)

    return decode


def _mask(path: Path) -> Config:
    config = Config(encoding=EncodingConfig(image_mask=str(path)))
    return masked(config, read_mask(config))


def _map() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, 'map.db')
        save_map(drawn(3), path)
        database = sqlite3.connect(path, isolation_level=None)
        database.execute(f'PRAGMA page_size = {_SMALLEST_PAGE_BYTES}')
        database.execute('VACUUM')
        database.close()
        return path.read_bytes()


def _table() -> bytes:
    row = ','.join('0.5' if 'score' in name else '1' for name in COLUMNS)
    return f'{",".join(COLUMNS)}\n{row}\n{row}\n'.encode()


_CAMERA = b"""image_width: 64
image_height: 48
camera_matrix: {rows: 3, cols: 3, data: [50, 0, 32, 0, 50, 24, 0, 0, 1]}
projection_matrix: {rows: 3, cols: 4, data:
  [50, 0, 32, 0, 0, 50,
  24, 0, 0, 0, 1, 0]}
"""
