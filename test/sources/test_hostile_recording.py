# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings made to take memory, time or more than that: one clear error, or what is whole."""

import os
import sqlite3
import struct
import threading
import tracemalloc

from convseq_ros.errors import SourceError
from convseq_ros.evaluation.truth_file import read_npy, read_pairs
from convseq_ros.reading_config import ReadingConfig
from convseq_ros.sources import open_source
from convseq_ros.sources.inflate import inflate
import numpy as np
import pytest
from rosbags.typesys.store import Typestore
import zstandard

MEGABYTE = 1 << 20
QUICK_S = 30


def read(path):
    """Return the frames up to the first error, that error, and the warnings."""
    frames = []
    try:
        source = open_source(path)
        frames.extend(source)
    except SourceError as error:
        return frames, str(error), []
    return frames, '', source.warnings


def in_time(work):
    """Return what some work returns, or fail if it does not end."""
    results = []
    thread = threading.Thread(target=lambda: results.append(work()), daemon=True)
    thread.start()
    thread.join(QUICK_S)
    assert results, 'still at it'
    return results[0]


def record(opcode, content):
    return struct.pack('<BQ', opcode, len(content)) + content


def first(data, opcode):
    """Return where the first record of a kind stands in an mcap file."""
    at = 8
    while data[at] != opcode:
        at += 9 + struct.unpack_from('<Q', data, at + 1)[0]
    return at


def zeros(megabytes):
    packer = zstandard.ZstdCompressor(level=1).compressobj()
    pieces = [packer.compress(bytes(MEGABYTE)) for _ in range(megabytes)]
    return b''.join(pieces) + packer.flush()


@pytest.mark.parametrize('declared', [400 * MEGABYTE, 1000, 2**62])
@pytest.mark.parametrize('layout', ['mcap plain', 'mcap zstd'])
def test_a_chunk_takes_no_more_memory_than_it_declares_and_may(
    recorder, pictures, layout, declared
):
    path = recorder.write(layout, recorder.drive(pictures))
    whole = path.read_bytes()
    packed = zeros(400)
    head = struct.pack('<QQQI', 0, 2**62, declared, 0) + struct.pack('<I', 4) + b'zstd'
    bomb = record(6, head + struct.pack('<Q', len(packed)) + packed)
    at = first(whole, 6)
    path.write_bytes(whole[:at] + bomb + whole[at:])
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
def test_how_large_a_chunk_may_be_is_a_parameter(recorder, layout):
    large = [np.full((1100, 1000), index, np.uint8) for index in range(2)]
    path = recorder.write(layout, recorder.drive(large))
    assert len([*open_source(path, reading=ReadingConfig(max_file_mb=1.2))]) == 2
    with pytest.raises(SourceError, match='max_file_mb'):
        [*open_source(path, reading=ReadingConfig(max_file_mb=1.0))]
    assert len([*open_source(path)]) == 2


def test_many_chunks_of_zeros_are_no_recording(recorder, pictures):
    path = recorder.write('mcap plain', recorder.drive(pictures))
    whole = path.read_bytes()
    packed = zeros(250)
    head = struct.pack('<QQQI', 0, 1, 250 * MEGABYTE, 0) + struct.pack('<I', 4) + b'zstd'
    bomb = record(6, head + struct.pack('<Q', len(packed)) + packed)
    at = first(whole, 6)
    path.write_bytes(whole[:at] + bomb * 10)
    assert 'which no recording does' in in_time(lambda: read(path))[1]


def test_an_index_that_lists_a_chunk_again_and_again_is_not_used(recorder, pictures):
    path = recorder.write('mcap zstd', recorder.drive(pictures))
    whole = path.read_bytes()
    at = first(whole, 8)
    length = 9 + struct.unpack_from('<Q', whole, at + 1)[0]
    path.write_bytes(whole[:at] + whole[at : at + length] * 3_000 + whole[at:])
    frames, _, warnings = in_time(lambda: read(path))
    assert len(frames) == 12
    assert 'its index cannot be used' in warnings[0]


def test_nothing_is_made_of_message_definitions_in_a_file(recorder, layout, pictures, monkeypatch):
    path = recorder.write(layout, recorder.drive(pictures))
    assert len(read(path)[0]) == 12
    monkeypatch.setattr(Typestore, 'register', lambda *_: pytest.fail('made code of data'))
    assert len(read(path)[0]) == 12


@pytest.mark.parametrize('name', ['drive.mcap', 'drive.db3', 'drive.bag', 'drive.mp4', 'drive'])
def test_a_pipe_with_the_name_of_a_recording_is_refused(tmp_path, name):
    os.mkfifo(tmp_path / name)
    assert 'is a pipe, not a file' in in_time(lambda: read(tmp_path / name))[1]


def test_a_device_and_links_in_a_circle_are_refused(tmp_path):
    (tmp_path / 'drive.mcap').symlink_to('/dev/zero')
    assert 'is a device' in in_time(lambda: read(tmp_path / 'drive.mcap'))[1]
    (tmp_path / 'circle.mcap').symlink_to('circle.mcap')
    assert 'Too many levels' in read(tmp_path / 'circle.mcap')[1]


@pytest.mark.parametrize('pipe', ['metadata.yaml', 'other.mcap', 'other.db3'])
def test_a_pipe_in_a_folder_is_left_out(recorder, pictures, pipe):
    path = recorder.write('mcap folder', recorder.drive(pictures))
    (path / pipe).unlink(missing_ok=True)
    os.mkfifo(path / pipe)
    frames, _, warnings = in_time(lambda: read(path))
    assert len(frames) == 12
    assert any('is a pipe' in line for line in warnings)


@pytest.mark.parametrize(
    'read_truth', [lambda path: read_pairs(path, [], []), lambda path: read_npy(path, (1, 1))]
)
def test_a_pipe_is_no_truth(tmp_path, read_truth):
    os.mkfifo(tmp_path / 'truth')

    def refused():
        with pytest.raises(SourceError, match='is a pipe'):
            read_truth(tmp_path / 'truth')
        return True

    assert in_time(refused)


COMPUTED = """
ALTER TABLE messages RENAME TO kept;
CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER,
    data BLOB GENERATED ALWAYS AS (zeroblob(400000000)));
INSERT INTO messages(id, topic_id, timestamp) SELECT id, topic_id, timestamp FROM kept;
DROP TABLE kept;
"""
VIEW = 'ALTER TABLE metadata RENAME TO kept; CREATE VIEW metadata AS SELECT * FROM kept;'
TRIGGER = 'CREATE TRIGGER t AFTER INSERT ON messages BEGIN DELETE FROM topics; END;'


@pytest.mark.parametrize(
    ('change', 'told'),
    [(COMPUTED, 'is computed'), (VIEW, 'no plain table'), (TRIGGER, 'no plain table')],
)
def test_a_database_that_computes_is_refused(recorder, pictures, change, told):
    path = recorder.write('db3 file', recorder.drive(pictures))
    with sqlite3.connect(path) as database:
        database.executescript(change)
    assert told in read(path)[1]


def test_pages_that_stand_for_many_are_refused(recorder, pictures):
    path = recorder.write('db3 file', recorder.drive(pictures[:1] * 400))
    data = bytearray(path.read_bytes())
    size = struct.unpack_from('>H', data, 16)[0]
    changed = 0
    for start in range(0, len(data), size):
        if data[start] == 5:  # an inner page of a table: all its children become the first
            (cells,) = struct.unpack_from('>H', data, start + 3)
            pointers = struct.unpack_from(f'>{cells}H', data, start + 12)
            child = data[start + pointers[0] : start + pointers[0] + 4]
            for pointer in pointers:
                data[start + pointer : start + pointer + 4] = child
            changed += cells
    assert changed
    path.write_bytes(data)
    frames, error, warnings = in_time(lambda: read(path))
    assert len(frames) <= 400
    assert error or warnings or len(frames) == 400


def test_metadata_that_refers_to_itself_is_not_used(recorder, pictures):
    path = recorder.write('mcap folder', recorder.drive(pictures))
    laughs = 'a0: &a0 [x, x]\n' + ''.join(
        f'a{number}: &a{number} [*a{number - 1}, *a{number - 1}]\n' for number in range(1, 22)
    )
    text = (path / 'metadata.yaml').read_text()
    text = text.replace('storage_identifier: ', 'storage_identifier: *a21 #')
    (path / 'metadata.yaml').write_text(laughs + text)
    frames, _, warnings = in_time(lambda: read(path))
    assert len(frames) == 12
    assert 'has aliases' in warnings[0]


@pytest.mark.parametrize('compression', ['zstd', 'lz4', 'bz2'])
def test_inflating_ends_where_it_may(compression):
    import bz2

    import lz4.frame

    pack = {'zstd': zstandard.compress, 'lz4': lz4.frame.compress, 'bz2': bz2.compress}
    packed = pack[compression](bytes(1000))
    assert inflate(packed, compression, 1000) == bytes(1000)
    with pytest.raises(SourceError, match='hold more than the 999'):
        inflate(packed, compression, 999)


def test_a_bag_without_lines_is_refused_before_it_is_read(tmp_path):
    with (tmp_path / 'drive.bag').open('wb') as file:
        file.truncate(10**12)
    assert 'does not begin as a recording does' in in_time(lambda: read(tmp_path / 'drive.bag'))[1]
