# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Every decoder, given what is almost right."""

from collections.abc import Callable, Iterator
from functools import partial
import mmap
import os
from pathlib import Path
import random
import resource
import select
import shutil
import signal
import struct
import tempfile
import time
import traceback
from types import SimpleNamespace
from typing import Any, NamedTuple

from convseq_ros.cli.options import read_parameter_file
from convseq_ros.errors import ConvseqError
from convseq_ros.evaluation.data_set import read_data_set
from convseq_ros.evaluation.report import read_runs
from convseq_ros.evaluation.report.curves import read_curve
from convseq_ros.evaluation.study import read_study
from convseq_ros.evaluation.truth_file import read_npy, read_pairs, read_positions
from convseq_ros.results import COLUMNS, read_results
from convseq_ros.sources import open_source
from convseq_ros.sources.camera_file import read_camera_file
from convseq_ros.sources.camera_info import camera_from_info
from convseq_ros.sources.images import decode_compressed, decode_image, decode_picture, ENCODINGS
from convseq_ros.sources.pose_file import read_pose_file
from convseq_ros.sources.pose_track import pose_from_message
from convseq_ros.sources.raw_message import RawMessage
import cv2
import numpy as np

from bench.torture import corpus
from bench.torture.attack import Try
from bench.torture.forked import BLOCKED_S, LOOK_S, MOST_BYTES, MOST_S
from bench.torture.spoil import spoil

ABOUT = (
    'Every decoder, given what is almost right: pictures, raw and compressed images, camera_info, '
    'poses, recordings, result tables, truth, YAML; so many executions each'
)
ORACLE = 'an answer, or an error of ours in one line; within 5 s, below 1 GB'
COUNT, PORTION, SHORT, SEED = 20_000, 1_000, 4, 16
_BATCH = 250
_NUMBERS = ('0', '-1', '1e308', 'nan', 'inf', '9' * 30, '1e99999999', '', '[]', '0x', '~', "'")


class Target(NamedTuple):
    """
    A decoder.

    Parameters
    ----------
    make : callable
        Draws its input.
    decode : callable
        Decodes it, in a folder that is empty.

    """

    make: Callable[[random.Random], Any]
    decode: Callable[[Any, Path], object]


def run(count: int, seed: int, folder: Path) -> Iterator[Try]:
    """Decode `count` inputs by each decoder, some hundred in a fork."""
    cv2.setNumThreads(1)
    for name, target in targets().items():
        for first in range(0, count, _BATCH):
            numbers = range(first, min(first + _BATCH, count))
            yield from _batch(name, target, numbers, seed, folder)


def targets() -> dict[str, Target]:
    """Return every decoder, by name."""
    found: dict[str, Target] = {}
    for kind, (_, data) in corpus.pictures().items():
        found[f'picture {kind}'] = _spoiled([data], lambda given, _: decode_picture(given))
    for name, decode in {
        'Image': decode_image,
        'CompressedImage': decode_compressed,
        'CameraInfo': camera_from_info,
        'PoseStamped': lambda message: pose_from_message(message.pose),
    }.items():
        kind = f'{"geometry" if "Pose" in name else "sensor"}_msgs/msg/{name}'
        found[f'message {name}'] = _spoiled(
            [corpus.cdr(kind)],
            lambda given, _, kind=kind, decode=decode: decode(RawMessage(0, kind, given).decode()),
        )
    found['fields of an image'] = Target(_image_fields, lambda given, _: decode_image(given))
    found['fields of a camera_info'] = Target(
        _camera_fields, lambda given, _: camera_from_info(given)
    )
    for kind, (name, files) in corpus.recordings().items():
        if '' in files:
            found[f'recording {kind}'] = _spoiled([files['']], partial(_recording, name))
    found |= {
        'parameter file': _spoiled([_PARAMETERS], _in_file('my.yaml', read_parameter_file)),
        'data set': _spoiled(
            [_DATA_SET], _in_file('set.yaml', lambda path: read_data_set(path, path.parent))
        ),
        'study': _spoiled(
            [_STUDY], _in_file('s.yaml', lambda path: read_study(path, path.parent))
        ),
        'camera file': _spoiled(
            [_CAMERA, b'P0: ' + b'1 ' * 12],
            _in_file('camera.yaml', lambda path: read_camera_file(path, 48, 64)),
        ),
        'pose file': _spoiled(
            [b'# t x y z\n' + b'1.5 1 2 3 0 0 0 1\n' * 3, b'1 0 0 0 0 1 0 0 0 0 1 0\n' * 3],
            _in_file('poses.txt', lambda path: read_pose_file(path, 3)(0, 1_500_000_000)),
        ),
        'truth of pairs': _spoiled(
            [b'query,reference,tolerance\n0,1 2,1\na.jpg,b.jpg,0\n'],
            _in_file('t.csv', lambda path: read_pairs(path, ['a.jpg'], ['b.jpg'])),
        ),
        'truth of positions': _spoiled(
            [b'drive,x,y,z\nquery,1,2,3\nquery,2,3,4\n'],
            _in_file('t.csv', lambda path: read_positions(path, 'query', 2)),
        ),
        'truth of NumPy': _spoiled(
            _arrays(), _in_file('t.npy', lambda path: read_npy(path, (3, 3)))
        ),
        'result table': _spoiled([_table()], _in_file('result.csv', read_results)),
        'run folder': _spoiled([b''], _run_folder),
    }
    return found


def _batch(name: str, target: Target, numbers: range, seed: int, folder: Path) -> Iterator[Try]:
    """Decode some inputs in a fork; in another one if that did not live to the end."""
    first = numbers.start
    while first < numbers.stop:
        at, problems = _in_fork(name, target, range(first, numbers.stop), seed, folder)
        for number in range(first, min(at + 1, numbers.stop)):
            yield Try(f'{name} {number}', problems.get(number, ''))
        first = at + 1


def _in_fork(
    name: str, target: Target, numbers: range, seed: int, folder: Path
) -> tuple[int, dict[int, str]]:
    """Return the last number that was tried, and what was wrong."""
    place = mmap.mmap(-1, 8)
    reader, writer = os.pipe()
    child = os.fork()
    if not child:
        os.close(reader)
        _decode_all(name, target, numbers, seed, folder, writer, place)
    os.close(writer)
    told, before, blocked_s = b'', -1, 0.0
    while blocked_s < BLOCKED_S:
        look_s = time.monotonic()
        if select.select([reader], [], [], LOOK_S)[0]:
            piece = os.read(reader, 65536)
            if not piece:
                break
            told += piece
        (at,) = struct.unpack('q', place[:8])
        blocked_s += min(LOOK_S, time.monotonic() - look_s)
        if at != before:
            before, blocked_s = at, 0.0
    stuck = blocked_s >= BLOCKED_S
    if stuck:
        os.kill(child, signal.SIGKILL)
    os.close(reader)
    _, status, usage = os.wait4(child, 0)
    (at,) = struct.unpack('q', place[:8])
    lines = [line.split('\t', 1) for line in told.decode(errors='replace').splitlines()]
    problems = {int(line[0]): line[1] for line in lines if len(line) == 2}
    if stuck:
        problems[at] = f'took more than {BLOCKED_S:g} s'
    elif os.WIFSIGNALED(status):
        problems[at] = f'killed by signal {os.WTERMSIG(status)}'
    elif usage.ru_maxrss * 1024 > MOST_BYTES:
        problems[at] = f'took {usage.ru_maxrss / 1e6:.1f} GB, or one of the {_BATCH} before'
    return at, problems


def _decode_all(
    name: str,
    target: Target,
    numbers: range,
    seed: int,
    folder: Path,
    writer: int,
    place: mmap.mmap,
) -> None:
    """Decode some inputs, tell what was wrong, and end this process."""
    resource.setrlimit(resource.RLIMIT_AS, (8 * MOST_BYTES, 8 * MOST_BYTES))
    silence = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silence, 2)
    own = Path(tempfile.mkdtemp(dir=folder))
    for number in numbers:
        place[:8] = struct.pack('q', number)
        started_s = time.process_time()
        problem = ''
        try:
            target.decode(target.make(random.Random(f'{name} {seed} {number}')), own)
        except ConvseqError as error:
            if len(str(error)) > 2000:
                problem = f'an error of {len(str(error))} characters'
        except BaseException:
            problem = ' | '.join(traceback.format_exc().splitlines()[-5:])
        _empty(own)
        took_s = time.process_time() - started_s
        if took_s > MOST_S:
            problem = f'took {took_s:.1f} s'
        if problem:
            os.write(writer, f'{number}\t{problem[:500]}\n'.encode(errors='replace'))
    os._exit(0)


def _empty(folder: Path) -> None:
    for one in [*folder.iterdir()]:
        if one.is_dir():
            shutil.rmtree(one)
        else:
            one.unlink()


def _spoiled(seeds: list[bytes], decode: Callable[[Any, Path], object]) -> Target:
    def make(draw: random.Random) -> bytes:
        data = draw.choice(seeds)
        if draw.random() < 0.4 and data[:1] < b'\x7f':
            # Of a text, a word becomes a number that is none, or very large.
            words = data.split(b' ')
            words[draw.randrange(len(words))] = draw.choice(_NUMBERS).encode()
            data = b' '.join(words)
        return spoil(data, draw)

    return Target(make, decode)


def _in_file(name: str, read: Callable[[Path], object]) -> Callable[[Any, Path], object]:
    def decode(data: bytes, folder: Path) -> object:
        (folder / name).write_bytes(data)
        return read(folder / name)

    return decode


def _recording(name: str, data: bytes, folder: Path) -> None:
    (folder / name).write_bytes(data)
    for _ in open_source(folder / name):
        pass


def _run_folder(data: bytes, folder: Path) -> None:
    draw = random.Random(data)
    own = folder / 'set' / 'method'
    own.mkdir(parents=True)
    files = {
        own / 'summary.json': b'{"set": "set", "method": "method", "accuracy_matched": 0.5}',
        own / 'frames.csv': _table(),
        own / 'curve.csv': b'threshold,precision,recall\n0.5,1,0.25\n',
        own / 'scores.npy': _arrays()[0],
        own.parent / 'set.json': b'{"name": "set", "queries": 3, "references": 3}',
    }
    victim = draw.choice(list(files))
    for path, content in files.items():
        path.write_bytes(spoil(content, draw) if path == victim else content)
    for one in read_runs([folder]):
        one.truth(), one.scores(), one.thumbnail('query', 0), read_curve(one.folder)


def _image_fields(draw: random.Random) -> Any:
    def side() -> int:
        return draw.choice((0, 1, 2, 3, 47, 48, 65_536, 2**31 - 1, 2**32 - 1))

    width = side()
    return SimpleNamespace(
        height=side(),
        width=width,
        encoding=draw.choice((*ENCODINGS, '', 'mono8 ', '32FC1', 'x' * 1000)),
        is_bigendian=draw.choice((0, 1, 255)),
        step=draw.choice((0, 1, width, 2 * width, 3 * width, 2**32 - 1)),
        data=draw.randbytes(draw.choice((0, 1, 100, 48 * 47, 3 * 48 * 48))),
    )


def _camera_fields(draw: random.Random) -> Any:
    def number() -> float:
        return draw.choice((0.0, -1.0, 1e-300, 1.0, 320.0, 1e308, float('inf'), float('nan')))

    def whole() -> int:
        return draw.choice((0, 1, 2, 640, 2**32 - 1))

    part = SimpleNamespace(width=whole(), height=whole(), x_offset=whole(), y_offset=whole())
    return SimpleNamespace(
        k=[number() for _ in range(9)],
        p=[number() for _ in range(12)],
        width=whole(),
        height=whole(),
        roi=part,
        binning_x=whole(),
        binning_y=whole(),
    )


def _arrays() -> list[bytes]:
    """Return .npy files of truth: pairs, a matrix, and VPR-Bench's array of objects."""
    objects = np.empty((3, 2), object)
    for number in range(3):
        objects[number] = number, [number, number + 1]
    made = []
    with tempfile.TemporaryDirectory() as folder:
        for array in (np.zeros((3, 2), np.int64), np.eye(3, dtype=np.bool_), objects):
            np.save(Path(folder, 'a.npy'), array, allow_pickle=True)
            made.append(Path(folder, 'a.npy').read_bytes())
    return made


def _table() -> bytes:
    row = ','.join('0.5' if 'score' in name else '1' for name in COLUMNS)
    return f'{",".join(COLUMNS)}\n{row}\n{row}\n'.encode()


_PARAMETERS = b"""/**:
  ros__parameters:
    matching: coherent
    max_length: 25
    closure_interval_s: 0.5
    subtract_background: true
"""
_DATA_SET = b"""name: street
query: {path: query, count: 3}
reference: {path: reference, topic: /camera}
truth: {kind: table, path: truth.csv, tolerance: 2}
published: {netvlad: scores.npy}
"""
_STUDY = b"""name: lengths
sets: [street_night]
methods: [convseq, seqslam-k10]
vary: {max_length: [5, 25]}
change: {noise: [1, 2.5]}
"""
_CAMERA = b"""image_width: 64
image_height: 48
camera_matrix: {rows: 3, cols: 3, data: [50, 0, 32, 0, 50, 24, 0, 0, 1]}
projection_matrix: {rows: 3, cols: 4, data: [50, 0, 32, 0, 0, 50, 24, 0, 0, 0, 1, 0]}
"""
