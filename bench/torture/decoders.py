# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""All decoders of foreign data, each with small valid inputs."""

from collections.abc import Callable
import functools
from functools import partial
import io
from pathlib import Path
import sqlite3
import tempfile
from typing import NamedTuple

from convseq_ros.cli.options import read_parameter_file
from convseq_ros.config import Config, EncodingConfig
from convseq_ros.core.encoding.view import masked
from convseq_ros.core.map.reader import MapReader
from convseq_ros.core.map.writer import MapWriter, save_map
from convseq_ros.core.result_row import COLUMNS
from convseq_ros.evaluation.data_set import read_data_set
from convseq_ros.evaluation.report.shown import read_runs
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
import numpy as np

from bench.torture import corpus
from bench.torture.maps import APART, drawn, ENCODING

_SMALLEST_PAGE_BYTES = 512  # of SQLite: a small map has a large share of structure
# Values for wrong places in a text, in addition to those of the fuzzer.
WORDS = ['9' * 30, *'-1 1e308 nan inf 1e99999999 [] {} 0x ~ &a *a !!'.split()]


class Decoder(NamedTuple):
    """A decoder: valid samples, and a function that decodes bytes, given an empty folder."""

    samples: list[bytes]
    decode: Callable[[bytes, Path], object]


def decoders() -> dict[str, Decoder]:
    """Return every decoder, by name."""
    by_name: dict[str, Decoder] = {}
    for kind, (_, data) in corpus.pictures().items():
        by_name[f'picture {kind}'] = Decoder([data], lambda given, _: picture_pixels(given))
    for name, read in {
        'Image': message_pixels,
        'CompressedImage': message_pixels,
        'CameraInfo': lambda message: camera_from_info(decode(message)),
        'PoseStamped': lambda message: pose_from_message(decode(message).pose),
    }.items():
        kind = f'{"geometry" if "Pose" in name else "sensor"}_msgs/msg/{name}'
        by_name[f'message {name}'] = Decoder(
            [corpus.cdr(kind)],
            lambda given, _, kind=kind, read=read: read(RawMessage(0, kind, given)),
        )
    for kind, (name, files) in corpus.recordings().items():
        if '' in files:
            by_name[f'recording {kind}'] = Decoder([files['']], partial(_recording, name))
    return by_name | {
        'map': Decoder([_map()], _in_file('map.db', _read_map)),
        'log of a map': Decoder([_ahead()[1]], _map_and_log),
        'image mask': Decoder([corpus.pictures()['png'][1]], _in_file('m.png', _mask)),
        'parameter file': Decoder([_PARAMETERS], _in_file('my.yaml', read_parameter_file)),
        'data set': Decoder(
            [_DATA_SET], _in_file('set.yaml', lambda path: read_data_set(path, path.parent))
        ),
        'camera file': Decoder(
            [_CAMERA, b'P0: ' + b'1 ' * 12],
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
            [b'drive,x,y,z\nquery,1,2,3\nquery,2,3,4\n'],
            _in_file('t.csv', lambda path: read_positions(path, 'query', 2)),
        ),
        'result table': Decoder([_table()], _in_file('result.csv', read_results)),
        'run folder': Decoder(
            [bytes([number]) + content for number, content in enumerate(_run().values())],
            _run_folder,
        ),
    }


def _in_file(name: str, read: Callable[[Path], object]) -> Callable[[bytes, Path], object]:
    def decode(data: bytes, folder: Path) -> object:
        (folder / name).write_bytes(data)
        return read(folder / name)

    return decode


def _mask(path: Path) -> Config:
    config = Config(encoding=EncodingConfig(image_mask=str(path)))
    return masked(config, read_mask(config))


def _recording(name: str, data: bytes, folder: Path) -> None:
    (folder / name).write_bytes(data)
    for _ in open_source(folder / name):
        pass


def _map() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, 'map.db')
        save_map(drawn(3), path)
        database = sqlite3.connect(path, isolation_level=None)
        database.execute(f'PRAGMA page_size = {_SMALLEST_PAGE_BYTES}')
        database.execute('VACUUM')
        database.close()
        return path.read_bytes()


@functools.cache
def _ahead() -> tuple[bytes, bytes]:
    """Return a map after a crash, and the log with its last places."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, 'map.db')
        path.write_bytes(_map())
        with MapWriter(path, ENCODING, APART, append=True) as writer:
            writer.write_ahead()
            writer.copy(drawn(5), 5)
            return path.read_bytes(), path.with_name('map.db-wal').read_bytes()


def _map_and_log(data: bytes, folder: Path) -> None:
    path = folder / 'map.db'
    path.write_bytes(_ahead()[0])
    path.with_name('map.db-wal').write_bytes(data)
    _read_map(path)


def _read_map(path: Path) -> None:
    reader = MapReader(path)
    reader.about()
    opened = reader.reference_map()
    opened.pictures(range(len(opened)), with_images=True)


def _run() -> dict[str, bytes]:
    """Return the files of a results folder, by name."""
    return {
        'set/method/summary.json': b'{"set": "set", "method": "method", "accuracy_matched": 0.5}',
        'set/method/frames.csv': _table(),
        'set/method/curve.csv': b'threshold,precision,recall\n0.5,1,0.25\n',
        'set/method/scores.npy': _scores(),
        'set/set.json': b'{"name": "set", "queries": 3, "references": 3}',
    }


def _run_folder(data: bytes, folder: Path) -> None:
    """Read a run in which one file, chosen by the first byte, has the other bytes as content."""
    files = _run()
    if data:
        files[[*files][data[0] % len(files)]] = data[1:]
    (folder / 'set' / 'method').mkdir(parents=True)
    for name, content in files.items():
        (folder / name).write_bytes(content)
    for one in read_runs([folder]):
        one.run.thumbnail('query', 0)


def _scores() -> bytes:
    """Return a .npy file of scores."""
    made = io.BytesIO()
    np.save(made, np.eye(3, dtype=np.float32))
    return made.getvalue()


def _table() -> bytes:
    row = ','.join('0.5' if 'score' in name else '1' for name in COLUMNS)
    return f'{",".join(COLUMNS)}\n{row}\n{row}\n'.encode()


_PARAMETERS = b"""/**:
  ros__parameters:
    matching: coherent
    fixed_length: 25
    closure_interval_s: 0.5
    both_directions: true
"""
_DATA_SET = b"""name: street
query: {path: query, count: 3}
reference: {path: reference, topic: /camera}
truth: {kind: table, path: truth.csv, tolerance: 2}
published: {netvlad: scores.npy}
"""
_CAMERA = b"""image_width: 64
image_height: 48
camera_matrix: {rows: 3, cols: 3, data: [50, 0, 32, 0, 50, 24, 0, 0, 1]}
projection_matrix: {rows: 3, cols: 4, data: [50, 0, 32, 0, 0, 50, 24, 0, 0, 0, 1, 0]}
"""
