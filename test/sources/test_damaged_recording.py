# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Cut, flipped, foreign and hostile recordings: frames that are right, or one clear error."""

import os
from pathlib import Path
import struct
import threading
import tracemalloc
import zipfile

from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.core.types import Frame
from convseq_ros.errors import SourceError
from convseq_ros.sources import open_source
from convseq_ros.sources.inflate import inflate
import numpy as np
import pytest
import recordings
from rosbags.typesys.store import Typestore
import zstandard

TOPIC = '/camera/image_raw'
MCAPS = ['mcap plain', 'mcap zstd', 'mcap lz4', 'mcap without chunks']


def read(path):
    """Return the frames up to the first error, that error, and the warnings."""
    frames = []
    try:
        source = open_source(path)
        for frame in source:
            assert isinstance(frame, Frame)
            assert (frame.gray is None) == bool(frame.problem)
            frames.append(frame)
    except SourceError as error:
        assert '\n' not in str(error) or '--topic' in str(error)
        return frames, str(error), []
    assert len(frames) == len(source) or source.warnings
    return frames, '', source.warnings


@pytest.mark.parametrize('layout', MCAPS)
def test_cut_mcap_yields_every_frame_up_to_the_cut(write, layout, pictures):
    path = write(layout, recordings.drive(pictures))
    whole = path.read_bytes()
    counts = []
    for cut in [*range(0, len(whole), max(1, len(whole) // 40)), len(whole) - 1]:
        path.write_bytes(whole[:cut])
        frames, error, warnings = read(path)
        counts.append(len(frames))
        for i, frame in enumerate(frames):
            np.testing.assert_array_equal(frame.gray, pictures[i])
            assert frame.stamp_ns == recordings.START_NS + recordings.STEP_NS * i
        assert bool(error) == (not frames) and len(warnings) == bool(frames)
        for line in warnings:
            assert 'at byte' in line and f'{len(frames)} frames of {TOPIC} were saved' in line
    assert counts == sorted(counts) and (counts[0], counts[-1]) == (0, 12)
    assert len(set(counts)) > 3


def test_without_chunks_a_frame_that_is_whole_in_the_file_is_never_lost(write, pictures):
    path = write('mcap without chunks', recordings.drive(pictures))
    whole = path.read_bytes()
    ends = [whole.index(gray.tobytes()) + gray.size for gray in pictures]
    for saved, end in enumerate(ends, start=1):
        path.write_bytes(whole[:end])
        assert len(read(path)[0]) == saved
        path.write_bytes(whole[: end - 1])
        assert len(read(path)[0]) == saved - 1


def test_a_split_recording_is_read_in_natural_order_up_to_a_cut_file(write, tmp_path, pictures):
    folder = tmp_path / 'split'
    folder.mkdir()
    for number, part in ((9, pictures[:6]), (10, pictures[6:])):
        base = tmp_path / str(number)
        base.mkdir()
        file = recordings.write_recording(base, 'mcap plain', recordings.drive(part))
        (folder / f'split_{number}.mcap').write_bytes(file.read_bytes())
    frames, _, warnings = read(folder)
    np.testing.assert_array_equal([frame.gray for frame in frames], pictures)
    assert not warnings
    last = folder / 'split_10.mcap'
    last.write_bytes(last.read_bytes()[:5500])
    frames, _, warnings = read(folder)
    assert 6 < len(frames) < 12 and len(warnings) == 1
    last.write_bytes(b'')
    frames, _, warnings = read(folder)
    assert len(frames) == 6
    assert 'split_10.mcap' in warnings[0] and 'left out' in warnings[0]


@pytest.mark.parametrize('layout', ['db3 file', 'sqlite3 folder', 'ros1 bag'])
@pytest.mark.parametrize('share', [0.0, 0.1, 0.5, 0.9, 0.999])
def test_other_cut_recordings_are_one_clear_error(write, layout, share, pictures):
    path = write(layout, recordings.drive(pictures))
    file = path / 'drive.db3' if path.is_dir() else path
    os.truncate(file, int(file.stat().st_size * share))
    frames, error, _ = read(path)
    assert frames == [] and str(file) in error


def test_frames_that_an_index_lists_but_that_are_gone_are_a_warning(write, tmp_path, pictures):
    path = write('mcap zstd', recordings.drive(pictures))
    source = open_source(path)
    write('mcap zstd', recordings.drive(pictures[:10]))
    assert len(list(source)) == 10
    assert '10 images' in source.warnings[0] and '12' in source.warnings[0]


@pytest.mark.parametrize(
    'layout', ['mcap folder', *MCAPS, 'db3 file', 'sqlite3 folder', 'ros1 bag']
)
def test_flipped_bits_give_frames_of_the_recording_or_one_error(write, layout, pictures):
    path = write(layout, recordings.drive(pictures[:6]))
    written = {recordings.START_NS + recordings.STEP_NS * at: pictures[at] for at in range(6)}
    has_checksums = layout in ('mcap plain', 'mcap zstd', 'mcap lz4')
    file = next(path.glob('drive.*')) if path.is_dir() else path
    whole = file.read_bytes()
    rng = np.random.default_rng(11)
    heads_and_tails = [*range(0, 120, 6), *range(len(whole) - 900, len(whole), 40)]
    for position in [*heads_and_tails, *rng.integers(0, len(whole), 20).tolist()]:
        damaged = bytearray(whole)
        damaged[position] ^= 1 << int(rng.integers(8))
        file.write_bytes(damaged)
        frames, _, _ = read(path)
        assert len(frames) <= 6
        for frame in frames if has_checksums else []:
            np.testing.assert_array_equal(frame.gray, written[frame.stamp_ns])


@pytest.mark.parametrize('suffix', ['.mcap', '.db3', '.bag'])
@pytest.mark.parametrize('kind', ['text', 'zip', 'empty', 'zeros', 'picture'])
def test_foreign_files_are_one_clear_error(tmp_path, suffix, kind, pictures):
    path = tmp_path / f'drive{suffix}'
    if kind == 'zip':
        with zipfile.ZipFile(path, 'w') as archive:
            archive.writestr('a.txt', 'hello' * 100)
    else:
        png = recordings.compressed(pictures[0]).data.tobytes()
        contents = {'text': b'hello\n' * 50, 'empty': b'', 'zeros': bytes(9999), 'picture': png}
        path.write_bytes(contents[kind])
    frames, error, _ = read(path)
    assert frames == [] and str(path) in error


@pytest.mark.parametrize('content', [None, '', 'a: b', '[1, 2', '\x00'])
def test_metadata_of_a_recorder_is_not_needed(write, layout, pictures, content):
    folder = write(layout, recordings.drive(pictures))
    if not (folder / 'metadata.yaml').exists():
        pytest.skip('no folder')
    if content is None:
        (folder / 'metadata.yaml').unlink()
    else:
        (folder / 'metadata.yaml').write_text(content)
    frames, error, warnings = read(folder)
    assert (len(frames), error, warnings) == (12, '', [])
    next(folder.glob('drive.*')).unlink()
    frames, error, _ = read(folder)
    assert str(folder) in error


MEGABYTE = 1 << 20


def in_time(work):
    """Return what some work returns, or fail if it does not end in half a minute."""
    results = []
    thread = threading.Thread(target=lambda: results.append(work()), daemon=True)
    thread.start()
    thread.join(30)
    assert results, 'still at it'
    return results[0]


def record(opcode, content):
    return struct.pack('<BQ', opcode, len(content)) + content


def chunk(packed, declared, end_ns):
    head = struct.pack('<QQQII4sQ', 0, end_ns, declared, 0, 4, b'zstd', len(packed))
    return record(6, head + packed)


def first(data, opcode):
    """Return where the first record of a kind stands in an mcap file."""
    at = 8
    while data[at] != opcode:
        at += 9 + struct.unpack_from('<Q', data, at + 1)[0]
    return at


def zeros(megabytes, piece=bytes(MEGABYTE)):
    packer = zstandard.ZstdCompressor(level=1).compressobj()
    pieces = [packer.compress(piece) for _ in range(megabytes)]
    return b''.join(pieces) + packer.flush()


@pytest.mark.parametrize('declared', [400 * MEGABYTE, 1000, 2**62])
@pytest.mark.parametrize('layout', ['mcap plain', 'mcap zstd'])
def test_a_chunk_takes_no_more_memory_than_declared_and_allowed(write, pictures, layout, declared):
    path = write(layout, recordings.drive(pictures))
    whole = path.read_bytes()
    at = first(whole, 6)
    path.write_bytes(whole[:at] + chunk(zeros(400), declared, 2**62) + whole[at:])
    tracemalloc.start()
    try:
        frames, error, warnings = read(path)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 300 * MEGABYTE
    assert (len(frames) == 12 and warnings) or error


@pytest.mark.parametrize(
    'layout', ['mcap zstd', 'mcap lz4', 'ros1 bag', 'sqlite3 folder compressed messages']
)
def test_a_parameter_limits_the_size_of_a_chunk(write, layout):
    large = [np.full((1100, 1000), index, np.uint8) for index in range(2)]
    path = write(layout, recordings.drive(large))
    assert len([*open_source(path, reading=ReadingConfig(max_file_mb=1.2))]) == 2
    with pytest.raises(SourceError, match='max_file_mb'):
        [*open_source(path, reading=ReadingConfig(max_file_mb=1.0))]
    assert len([*open_source(path)]) == 2


def test_many_compressed_chunks_of_zeros_are_refused_in_time(write, pictures):
    path = write('mcap plain', recordings.drive(pictures))
    whole = path.read_bytes()
    packed = zeros(240, record(0x80, bytes(MEGABYTE - 9)))  # of a private kind, passed over
    path.write_bytes(whole[: first(whole, 6)] + chunk(packed, 240 * MEGABYTE, 1) * 10)
    assert 'which no recording does' in in_time(lambda: read(path))[1]


def test_no_code_is_made_of_message_definitions_in_a_file(write, layout, pictures, monkeypatch):
    path = write(layout, recordings.drive(pictures))
    assert len(read(path)[0]) == 12
    monkeypatch.setattr(Typestore, 'register', lambda *_: pytest.fail('made code of data'))
    assert len(read(path)[0]) == 12


@pytest.mark.parametrize('pipe', ['other.mcap', 'other.db3'])
def test_a_pipe_in_a_folder_is_left_out(write, pictures, pipe):
    path = write('mcap folder', recordings.drive(pictures))
    (path / 'metadata.yaml').unlink()
    os.mkfifo(path / pipe)
    frames, _, warnings = in_time(lambda: read(path))
    assert len(frames) == 12 and any('is a pipe' in line for line in warnings)


@pytest.mark.parametrize('compression', ['zstd', 'lz4', 'bz2'])
def test_decompression_stops_at_its_limit(compression):
    import bz2

    import lz4.frame

    pack = {'zstd': zstandard.compress, 'lz4': lz4.frame.compress, 'bz2': bz2.compress}
    packed = pack[compression](bytes(1000))
    assert inflate(packed, compression, 1000) == bytes(1000)
    with pytest.raises(SourceError, match='hold more than the 999'):
        inflate(packed, compression, 999)


def endless(path):
    path.touch()
    os.truncate(path, 10**12)


PIPES = '', '.mcap', '.db3', '.bag', '.mp4'
NO_RECORDINGS = [  # a name, what makes it, and what is said of it
    ('missing.mcap', None, 'no such file'),
    ('', None, 'no pictures and no recording'),
    ('notes.txt', Path.touch, 'expected a folder or a .mcap, .db3, .bag file'),
    *((f'drive{one}', os.mkfifo, 'is a pipe, not a file') for one in PIPES),
    ('drive.mcap', lambda path: path.symlink_to('/dev/zero'), 'is a device'),
    ('circle.mcap', lambda path: path.symlink_to(path.name), 'Too many levels'),
    ('drive.bag', endless, 'does not begin as a recording does'),  # before it is read
]


@pytest.mark.parametrize(('name', 'make', 'told'), NO_RECORDINGS)
def test_what_is_no_recording_is_one_clear_error_in_time(tmp_path, name, make, told):
    if make:
        make(tmp_path / name)
    assert told in in_time(lambda: read(tmp_path / name))[1]
