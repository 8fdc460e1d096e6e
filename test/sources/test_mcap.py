# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Chunks of an mcap that do not suit their checksums, and an mcap of other programs."""

import pytest

pytest.importorskip('mcap', reason='needs mcap: pip install mcap')

from convseq_ros.errors import SourceError
from convseq_ros.sources import open_source
from convseq_ros.sources.recording import read_poses
from mcap.reader import make_reader
from mcap.writer import Writer
import numpy as np
import recordings

TOPIC = '/camera/image_raw'
PACKED = ['mcap plain', 'mcap zstd', 'mcap lz4']


def chunks_of(path):
    """Return for each chunk where it starts, where its data ends, and its number of images."""
    with path.open('rb') as file:
        summary = make_reader(file).get_summary()
        logged = [*make_reader(file).iter_messages(TOPIC)]
    chunks = []
    for chunk in summary.chunk_indexes:
        times = chunk.message_start_time, chunk.message_end_time
        count = sum(times[0] <= message.log_time <= times[1] for *_, message in logged)
        start = chunk.chunk_start_offset
        chunks.append((start, start + chunk.chunk_length, count))
    return chunks


def flip(path, position):
    damaged = bytearray(path.read_bytes())
    damaged[position] ^= 1
    path.write_bytes(damaged)


@pytest.mark.parametrize('layout', PACKED)
@pytest.mark.parametrize('damaged', [slice(0, 1), slice(1, 2), slice(1, 3)])
def test_flipped_bits_cost_chunks_and_are_reported(write, layout, damaged, pictures):
    path = write(layout, recordings.drive(pictures))
    chunks = chunks_of(path)
    assert len(chunks) > 2
    for _, end, _ in chunks[damaged]:
        flip(path, end - 100)
    source = open_source(path)
    counts = [count for *_, count in chunks]
    before, lost = sum(counts[: damaged.start]), sum(counts[damaged])
    for _ in range(2):
        kept = [*pictures[:before], *pictures[before + lost :]]
        np.testing.assert_array_equal([frame.gray for frame in source], kept)
        assert source.warnings == [
            f'{path}: damaged chunks: {len(chunks[damaged])}, the first at byte '
            f'{chunks[damaged][0][0]}; left out: copy it again',
            f'{path}: {12 - lost} images of {TOPIC} were read, but its index lists 12; it may be '
            'damaged',
        ]


def test_a_damaged_chunk_costs_no_message_of_topics_outside_of_it(write, pictures):
    odometry = [('/odom', i + 1, recordings.odometry(float(i), i + 1)) for i in range(5)]
    path = write('mcap plain', [*odometry, *recordings.drive(pictures)])
    flip(path, chunks_of(path)[-1][1] - 100)
    assert len(read_poses(path, '/odom')) == 5


@pytest.mark.parametrize('is_whole', [True, False])
@pytest.mark.parametrize(
    ('encoding', 'kind', 'remedy'),
    [
        ('ros1', 'sensor_msgs/Image', 'give the .bag that it was made of'),
        ('json', 'Photo', 'convert it'),
        ('protobuf', 'foxglove.CompressedImage', 'convert it'),
    ],
)
def test_an_mcap_of_others_is_refused_by_its_encoding(tmp_path, encoding, kind, remedy, is_whole):
    path = tmp_path / 'drive.mcap'
    with path.open('wb') as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema(kind, encoding, b'')
        channel = writer.register_channel('/photo', encoding, schema)
        writer.add_message(channel, 1, b'{}', 1)
        writer.finish()
    if not is_whole:
        path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(SourceError) as caught:
        open_source(path)
    assert str(caught.value) == (
        f'{path}: its messages are {encoding}, such as /photo ({kind}), and not cdr as ROS 2 '
        f'writes them; {remedy}'
    )
