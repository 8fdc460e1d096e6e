# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A folder with several files of a recording: which are read; a recorder that was killed."""

import shutil
import sqlite3

from convseq_ros.errors import SourceError
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


def test_a_file_compressed_after_recording_is_the_one_that_metadata_names(write, pictures):
    folder = write('sqlite3 folder', recordings.drive(pictures))
    file = folder / 'drive.db3'
    (folder / 'drive.db3.zstd').write_bytes(zstandard.compress(file.read_bytes()))
    file.unlink()
    assert_shows(folder, pictures)


@pytest.fixture
def killed(write, tmp_path, pictures):
    """Return what leaves a .db3 with its first images, and a -wal file with all or no more."""

    def leave(in_file, committed=True):
        whole = write('db3 file', recordings.drive(pictures))
        writer = sqlite3.connect(whole, isolation_level=None)
        writer.execute('PRAGMA journal_mode = WAL')
        later = f'id > (SELECT id FROM messages ORDER BY id LIMIT 1 OFFSET {in_file - 1})'
        kept = writer.execute(f'SELECT * FROM messages WHERE {later}').fetchall()
        writer.execute(f'DELETE FROM messages WHERE {later}')
        writer.execute('VACUUM')
        writer.execute('PRAGMA wal_checkpoint(TRUNCATE)')
        writer.execute('BEGIN')
        places = ', '.join('?' * len(kept[0]))
        writer.executemany(f'INSERT INTO messages VALUES ({places})', kept)
        if committed:
            writer.execute('COMMIT')
        folder = tmp_path / 'killed'
        folder.mkdir()
        for file in whole.parent.glob('drive.db3*'):
            shutil.copy(file, folder)
        writer.close()
        return folder / 'drive.db3'

    return leave


def test_all_committed_messages_are_read_and_nothing_is_changed(killed, pictures):
    path = killed(in_file=4)
    before = {file: file.read_bytes() for file in path.parent.iterdir()}
    assert path.with_name('drive.db3-wal') in before
    assert_shows(path, pictures)
    assert {file: file.read_bytes() for file in path.parent.iterdir()} == before
    path.with_name('drive.db3-wal').unlink()
    assert_shows(path, pictures[:4])


def test_a_message_that_was_not_committed_is_left_out(killed, pictures):
    assert_shows(killed(in_file=4, committed=False), pictures[:4])


def test_a_file_that_is_cut_is_refused_unless_its_log_holds_the_rest(killed):
    path = killed(in_file=4)
    path.write_bytes(path.read_bytes()[:4096])  # the first page alone
    with pytest.raises(SourceError, match='cut short, and its -wal file does not hold the rest'):
        open_source(path)


def test_a_recording_that_is_only_in_the_log_is_read(tmp_path, write, pictures):
    whole = write('db3 file', recordings.drive(pictures))
    path = tmp_path / 'new.db3'
    source, target = sqlite3.connect(whole), sqlite3.connect(path, isolation_level=None)
    target.execute('PRAGMA journal_mode = WAL')
    target.executescript('BEGIN;' + '\n'.join(source.iterdump()).split('\n', 1)[1])
    copy = tmp_path / 'copy' / 'new.db3'
    copy.parent.mkdir()
    for file in tmp_path.glob('new.db3*'):
        shutil.copy(file, copy.parent)
    assert copy.stat().st_size == 4096  # a page, which holds no table
    assert_shows(copy, pictures)
