# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Videos as sources."""

from convseq_ros.errors import SourceError
from convseq_ros.sources import open_source
import cv2
import numpy as np
import pytest


@pytest.fixture
def video(tmp_path):
    path = tmp_path / 'drive.avi'
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*'MJPG'), 20, (64, 48))
    if not writer.isOpened():
        pytest.skip('this OpenCV writes no MJPG video')
    for level in (0, 100, 200):
        writer.write(np.full((48, 64, 3), level, np.uint8))
    writer.release()
    return path


def test_a_video_gives_its_frames_in_time(video):
    source = open_source(video)
    assert len(source) == 3
    for _ in range(2):
        frames = list(source)
        assert [frame.stamp_ns for frame in frames] == [0, 50_000_000, 100_000_000]
        assert [round(frame.gray.mean(), -1) for frame in frames] == [0, 100, 200]
        assert frames[0].gray.shape == (48, 64)
    assert source.warnings == []


def test_a_video_has_no_topics(video):
    with pytest.raises(SourceError, match="a video has no topic '/image'"):
        open_source(video, '/image')


def test_what_opencv_cannot_read_is_refused(tmp_path):
    (tmp_path / 'bad.mp4').write_bytes(b'no video')
    with pytest.raises(SourceError, match=r'bad.mp4: OpenCV cannot read this video'):
        open_source(tmp_path / 'bad.mp4')
    with pytest.raises(SourceError, match='no such file'):
        open_source(tmp_path / 'absent.mp4')
