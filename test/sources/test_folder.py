# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Folders of pictures: order, stamps, and what can be wrong with them."""

import re

from convseq_ros.errors import SourceError
from convseq_ros.sources import open_source
from convseq_ros.sources.folder import ImageFolder
import cv2
import numpy as np
import pytest


def draw(path, value=100, shape=(6, 8)):
    channels = () if path.suffix == '.pgm' else (3,)
    picture = np.full((*shape, *channels), value, np.uint8)
    assert cv2.imwrite(str(path), picture)


def test_pictures_come_in_natural_order(tmp_path):
    for number in (10, 2, 1, 11, 20):
        draw(tmp_path / f'img{number}.png', number)
    frames = list(ImageFolder(tmp_path))
    assert [frame.source for frame in frames] == [f'img{n}.png' for n in (1, 2, 10, 11, 20)]
    assert [int(frame.gray[0, 0]) for frame in frames] == [1, 2, 10, 11, 20]


def test_stamps_are_a_tenth_of_a_second_apart_without_better_names(tmp_path):
    for number in range(3):
        draw(tmp_path / f'{number}.png')
    assert [frame.stamp_ns for frame in ImageFolder(tmp_path)] == [10**8, 2 * 10**8, 3 * 10**8]


def test_long_numbers_are_stamps(tmp_path):
    stamps = [1403636579763555584, 1403636579813555456, 1520530308199447626]
    for stamp in reversed(stamps):
        draw(tmp_path / f'{stamp}.png')
    assert [frame.stamp_ns for frame in ImageFolder(tmp_path)] == stamps


def test_other_files_hidden_files_and_folders_are_left_out(tmp_path):
    draw(tmp_path / 'a.png')
    (tmp_path / 'truth.csv').write_text('1,2')
    (tmp_path / '._a.png').write_bytes(b'resource fork')
    (tmp_path / 'b.png').mkdir()
    folder = ImageFolder(tmp_path)
    assert len(folder) == 1
    assert [frame.source for frame in folder] == ['a.png']


@pytest.mark.parametrize('content', [b'', b'not a picture', b'\xff\xd8\xff\xe0 cut'])
def test_an_unreadable_picture_is_a_frame_that_says_why(tmp_path, content):
    draw(tmp_path / '1.png')
    (tmp_path / '2.jpg').write_bytes(content)
    draw(tmp_path / '3.png')
    first, unreadable, last = ImageFolder(tmp_path)
    assert [first.source, unreadable.source, last.source] == ['1.png', '2.jpg', '3.png']
    assert unreadable.gray is None and unreadable.stamp_ns == 2 * 10**8
    assert re.fullmatch(
        r'.*/2\.jpg: not a readable picture \(.*\); restore it or remove it', unreadable.problem
    )
    assert first.gray is not None is not last.gray and not first.problem


def test_missing_empty_and_pictureless_folders_are_errors(tmp_path):
    with pytest.raises(SourceError, match='no such folder'):
        ImageFolder(tmp_path / 'missing')
    with pytest.raises(SourceError, match='no pictures'):
        open_source(tmp_path)
    (tmp_path / 'notes.txt').write_text('hello')
    with pytest.raises(SourceError, match=r'no pictures.*jpg.*\.mcap') as caught:
        open_source(tmp_path)
    assert '\n' not in str(caught.value)


def test_a_topic_of_a_folder_is_an_error(tmp_path):
    draw(tmp_path / 'a.png')
    with pytest.raises(SourceError, match='/camera'):
        open_source(tmp_path, '/camera')
