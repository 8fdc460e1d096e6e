# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Folders of pictures: order, stamps, and what can be wrong with them."""

import math
import re

from convseq_ros.cli.recording import describe_recording
from convseq_ros.errors import SourceError
from convseq_ros.sources import open_annotated, open_each_camera, open_source
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


@pytest.mark.parametrize(
    ('names', 'stamps_ns'),
    [
        (['1403636579763555584', '1520530308199447626'],
         [1403636579763555584, 1520530308199447626]),
        (['1305031102.2', '1305031102.175304'], [1305031102175304000, 1305031102200000000]),
        (['left_1403636579.763555584', 'left_1403636580.0'],
         [1403636579763555584, 1403636580000000000]),
        (['1400505794141322', '1400505794203809'], [1400505794141322000, 1400505794203809000]),
        (['1493047323123', '1493047323223'], [1493047323123000000, 1493047323223000000]),
        # Dates count as UTC.
        (['center_2022_02_09_16_15_53_331', 'center_2022_02_09_16_15_53_409'],
         [1644423353331000000, 1644423353409000000]),
        (['PXL_20220209_161553331', 'PXL_20220209_161554000'],
         [1644423353331000000, 1644423354000000000]),
        (['2022-02-09T16:15:53', '2022-02-09T16:15:55'],
         [1644423353000000000, 1644423355000000000]),
        # Two in one second: the order of their names is all that is known.
        (['IMG_20220209_161553', 'IMG 20220209_161553'], [10**8, 2 * 10**8]),
        # Other numbers are no times: frames are a tenth of a second apart.
        (['0', '1', '2'], [10**8, 2 * 10**8, 3 * 10**8]),
        *(([name], [10**8]) for name in (
            '0000000007', '12345678901', '9999999999999999999', '2011-09-26', 'frame-000007',
            '2022_02_39_16_15_53_331', '20220209161553_4',
        )),
    ],
)  # fmt: skip
def test_times_in_names_are_stamps(tmp_path, names, stamps_ns):
    for name in names:
        draw(tmp_path / f'{name}.png')
    folder = ImageFolder(tmp_path)
    assert [frame.stamp_ns for frame in folder] == stamps_ns and folder.warnings == []


@pytest.mark.parametrize(
    ('names', 'kept', 'line'),
    [
        # Udacity's simulator, without and with times.
        (['right_1', 'left_1', 'center_1', 'right_2', 'left_2', 'center_2'],
         ['center_1', 'center_2'],
         '4 of 6 pictures, such as left_1.png, are left out: they are of another camera; give'),
        (['left_2022_02_09_16_15_53_331', 'center_2022_02_09_16_15_53_331'],
         ['center_2022_02_09_16_15_53_331'],
         '1 of 2 pictures, such as left_2022_02_09_16_15_53_331.png, are left out: they are of'),
        (['cam0_1305031102.1', 'cam0_1305031102.2', 'cam1_1305031102.1'],
         # These keep their numbers; the recogniser passes over the second of a time.
         ['cam0_1305031102.1', 'cam1_1305031102.1', 'cam0_1305031102.2'],
         '1 of 3 pictures, such as cam1_1305031102.1.png, are left out: they have the time of'),
        # A word of one's own is no camera's.
        (['leftover_1', 'rightful_1'], ['leftover_1', 'rightful_1'], None),
    ],
)  # fmt: skip
def test_of_several_cameras_in_one_folder_the_first_is_taken(tmp_path, names, kept, line):
    for name in names:
        draw(tmp_path / f'{name}.png')
    folder = ImageFolder(tmp_path)
    assert [frame.source for frame in folder] == [f'{name}.png' for name in kept]
    assert [line in one for one in folder.warnings] == ([True] if line else [])


def test_a_rate_is_that_of_the_pictures_whatever_their_names(tmp_path):
    for name in ('1305031102.1', '1305031102.2', '1305031102.4'):
        draw(tmp_path / f'{name}.png')
    (source,) = open_each_camera(tmp_path, rate_hz=2.0)
    assert [frame.stamp_ns for frame in source] == [5 * 10**8, 10**9, 15 * 10**8]
    for wrong in (0.0, -1.0, 1e4, math.nan):
        with pytest.raises(SourceError, match=r'--rate \S+: is out of bounds; give 0.001 to 1000'):
            open_source(tmp_path, rate_hz=wrong)
    with pytest.raises(SourceError, match=r'a.mcap: has times of its own; leave out --rate 2'):
        open_source(tmp_path / 'a.mcap', rate_hz=2.0)


def test_file_names_of_which_only_some_are_times_are_reported(tmp_path):
    for name in ('1305031102.175304', '1305031102.211214', 'cover'):
        draw(tmp_path / f'{name}.png')
    folder = ImageFolder(tmp_path)
    assert [frame.stamp_ns for frame in folder] == [10**8, 2 * 10**8, 3 * 10**8]
    (line,) = folder.warnings
    assert '1 of 3 names have no time, such as cover.png; images count as 0.1 s apart' in line


@pytest.mark.parametrize(
    ('color', 'depth'),
    [
        ('frame-{}.color.png', 'frame-{}.depth.png'),  # 7-Scenes
        ('frame-{}.color.jpg', 'frame-{}.depth.pgm'),  # ScanNet
        ('rgb_{}.jpg', 'Depth_{}.png'),
        ('{}.jpg', '{}_label.png'),
    ],
)
def test_depth_and_label_images_beside_others_are_left_out(tmp_path, color, depth):
    for number in range(2):
        draw(tmp_path / color.format(number), 100 + number)
        cv2.imwrite(str(tmp_path / depth.format(number)), np.full((6, 8), 1000, np.uint16))
    source = open_source(tmp_path)
    assert [frame.gray[0, 0] for frame in source] == [100, 101]
    (line,) = source.warnings
    assert f'2 of 4 pictures, such as {depth.format(0)}, are left out: they show depth' in line
    facts = {'recording': str(tmp_path), 'images': 2, 'warnings': [line]}
    assert describe_recording(tmp_path) == facts
    # A folder of nothing but depth is read.
    for number in range(2):
        (tmp_path / color.format(number)).unlink()
    assert len(open_source(tmp_path)) == 2 and not open_source(tmp_path).warnings


def test_poses_of_other_times_than_the_pictures_are_refused(tmp_path):
    draw(tmp_path / '7.png')
    poses = tmp_path / 'groundtruth.txt'
    poses.write_text('1305031102.1 0 0 0 0 0 0 1\n1305031102.2 1 0 0 0 0 0 1\n')
    with pytest.raises(SourceError, match=r'groundtruth.txt: has no pose .* 0.100 to 0.100 s'):
        open_annotated(tmp_path, poses=poses)
    (tmp_path / '7.png').rename(tmp_path / '1305031102.175304.png')
    (frame,) = open_annotated(str(tmp_path), poses=poses)
    assert frame.pose.position[0] == pytest.approx(0.75304)


def test_folders_of_pictures_in_a_folder_are_named(tmp_path):
    for name in ('rgb', 'depth', 'mav0/cam0/data'):
        (tmp_path / name).mkdir(parents=True)
        draw(tmp_path / name / '1.png')
    with pytest.raises(SourceError) as caught:
        open_source(tmp_path)
    within = f'{tmp_path}/depth (1), {tmp_path}/rgb (1), {tmp_path}/mav0/cam0/data (1)'
    assert str(caught.value) == (
        f'{tmp_path}: no pictures and no recording in this folder; give a folder in it: {within}'
    )


def test_other_files_hidden_files_and_folders_are_left_out(tmp_path):
    draw(tmp_path / 'a.png')
    (tmp_path / 'truth.csv').write_text('1,2')
    (tmp_path / '._a.png').write_bytes(b'resource fork')
    (tmp_path / 'b.png').mkdir()
    folder = ImageFolder(tmp_path)
    assert len(folder) == 1 and [frame.source for frame in folder] == ['a.png']


@pytest.mark.parametrize('content', [b'', b'not a picture', b'\xff\xd8\xff\xe0 cut'])
def test_an_unreadable_picture_becomes_a_frame_with_its_problem(tmp_path, content):
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


def test_a_link_to_a_missing_picture_keeps_its_frame(tmp_path):
    draw(tmp_path / '1.png')
    (tmp_path / '2.png').symlink_to('absent.png')
    draw(tmp_path / '3.png')
    frames = [*ImageFolder(tmp_path)]
    assert [frame.source for frame in frames] == ['1.png', '2.png', '3.png']
    assert 'No such file or directory' in frames[1].problem


def test_missing_empty_and_pictureless_folders_and_topics_of_one_are_errors(tmp_path):
    with pytest.raises(SourceError, match='No such file'):
        ImageFolder(tmp_path / 'missing')
    with pytest.raises(SourceError, match='no pictures'):
        open_source(tmp_path)
    (tmp_path / 'notes.txt').write_text('hello')
    with pytest.raises(SourceError, match=r'no pictures.*jpg.*\.mcap') as caught:
        open_source(tmp_path)
    assert '\n' not in str(caught.value)
    draw(tmp_path / 'a.png')
    with pytest.raises(SourceError, match='/camera'):
        open_source(tmp_path, '/camera')
