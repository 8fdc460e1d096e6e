# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A folder with several files of a recording: which are read."""

import shutil

from convseq_ros.sources import open_source
from convseq_ros.sources.storage import open_storage
import numpy as np
import recordings
import zstandard


def assert_shows(path, pictures, *lines):
    source = open_source(path)
    assert len(source) == len(pictures)
    np.testing.assert_array_equal([frame.gray for frame in source], pictures)
    assert len(source.warnings) == len(lines)
    for line, words in zip(source.warnings, lines, strict=True):
        assert words in line


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


def test_parts_that_metadata_names_and_nobody_copied_are_told(write, pictures):
    folder = write('mcap folder', recordings.drive(pictures))
    about = folder / 'metadata.yaml'
    parts = '- drive.mcap\n  - drive_1.mcap\n  - drive_2.mcap\n'
    about.write_text(f'rosbag2_bagfile_information:\n  relative_file_paths:\n  {parts}')
    assert_shows(folder, pictures, 'metadata.yaml names drive_1.mcap, drive_2.mcap, not there')


def test_a_file_that_was_compressed_after_recording_is_the_one_that_metadata_names(
    write, pictures
):
    folder = write('sqlite3 folder', recordings.drive(pictures))
    file = folder / 'drive.db3'
    (folder / 'drive.db3.zstd').write_bytes(zstandard.compress(file.read_bytes()))
    file.unlink()
    assert_shows(folder, pictures)
