# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A folder with several files of a recording: each message is read once."""

import shutil

from convseq_ros.sources import open_source
from convseq_ros.sources.storage import open_storage
import numpy as np
import pytest
import recordings
import zstandard


def assert_shows(path, pictures, *lines):
    source = open_source(path)
    assert len(source) == len(pictures)
    np.testing.assert_array_equal([frame.gray for frame in source], pictures)
    assert len(source.warnings) == len(lines)
    for line, words in zip(source.warnings, lines, strict=True):
        assert words in line


@pytest.mark.parametrize('layout', ['mcap folder', 'sqlite3 folder'])
@pytest.mark.parametrize('has_metadata', [True, False])
def test_a_file_beside_its_compressed_copy_is_read_once(write, pictures, layout, has_metadata):
    folder = write(layout, recordings.drive(pictures))
    (file,) = folder.glob('drive.*')
    copy = folder / f'{file.name}.zstd'
    copy.write_bytes(zstandard.compress(file.read_bytes()))
    told = f'metadata.yaml does not name {copy.name}; left out'
    if not has_metadata:
        (folder / 'metadata.yaml').unlink()
        told = f'{copy}: {file.name} holds the same messages; left out'
    assert_shows(folder, pictures, told)


def test_metadata_decides_which_files_are_read(write, tmp_path, pictures):
    folder = write('mcap folder', recordings.drive(pictures))
    other = tmp_path / 'other'
    other.mkdir()
    more = recordings.write_recording(other, 'mcap plain', recordings.drive(pictures[:3], '/left'))
    shutil.copy(more, folder / 'a_left.mcap')
    assert_shows(folder, pictures, 'does not name a_left.mcap')
    (folder / 'metadata.yaml').unlink()
    storages, warnings = open_storage(folder)
    assert [storage.path.name for storage in storages] == ['a_left.mcap', 'drive.mcap']
    assert not warnings


def test_a_file_that_was_compressed_after_recording_is_the_one_that_metadata_names(
    write, pictures
):
    folder = write('sqlite3 folder', recordings.drive(pictures))
    file = folder / 'drive.db3'
    (folder / 'drive.db3.zstd').write_bytes(zstandard.compress(file.read_bytes()))
    file.unlink()
    assert_shows(folder, pictures)


@pytest.mark.parametrize('suffix', ['', '_recovered'])
def test_a_whole_file_is_read_instead_of_its_truncated_copy(write, tmp_path, pictures, suffix):
    whole = write('mcap plain', recordings.drive(pictures))
    folder = tmp_path / 'both'
    folder.mkdir()
    content = whole.read_bytes()
    cut, full = ('a.mcap', 'a_recovered.mcap') if suffix else ('b.mcap', 'a.mcap')
    (folder / cut).write_bytes(content[: len(content) // 2])
    (folder / full).write_bytes(content)
    assert_shows(folder, pictures, f'{cut}: {full} holds the same messages')


def test_a_bag_beside_its_original_is_read_once(write, pictures):
    bag = write('ros1 bag', recordings.drive(pictures))
    shutil.copy(bag, bag.with_name('drive.orig.bag'))
    assert_shows(bag.parent, pictures, 'drive.orig.bag: drive.bag holds the same messages')


def test_the_same_times_with_other_images_are_another_recording(write, tmp_path, pictures):
    folder = tmp_path / 'both'
    folder.mkdir()
    for name, part in (('a', pictures[:6]), ('b', pictures[6:])):
        shutil.copy(write('mcap plain', recordings.drive(part)), folder / f'{name}.mcap')
    assert_shows(folder, pictures)
