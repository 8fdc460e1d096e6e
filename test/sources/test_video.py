# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Videos: their frames, their times, and what can be wrong with them."""

from convseq_ros.cli.recording import describe_recording
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


def test_a_video_that_opencv_cannot_read_is_refused(tmp_path):
    (tmp_path / 'bad.mp4').write_bytes(b'no video')
    with pytest.raises(SourceError, match=r'bad.mp4: OpenCV cannot read this video'):
        open_source(tmp_path / 'bad.mp4')
    with pytest.raises(SourceError, match='no such file'):
        open_source(tmp_path / 'absent.mp4')


def matroska(path, times_ms):
    """Write frames as a browser does: Matroska with a time for each, no rate and no length."""

    def element(ident, content):
        return bytes.fromhex(ident) + (len(content) | 1 << 56).to_bytes(8, 'big') + content

    def numbers(**values):
        return b''.join(element(name[1:], bytes([value])) for name, value in values.items())

    video = element('E0', numbers(_B0=64, _BA=48))
    track = numbers(_D7=1, _83=1) + element('86', b'V_MJPEG') + video
    clock = element('2AD7B1', (1_000_000).to_bytes(4, 'big'))  # nanoseconds in a tick
    unknown = bytes([1]) + b'\xff' * 7
    content = element('1A45DFA3', element('4282', b'matroska'))
    content += bytes.fromhex('18538067') + unknown + element('1549A966', clock)
    content += element('1654AE6B', element('AE', track))
    for level, time_ms in enumerate(times_ms):
        jpeg = cv2.imencode('.jpg', np.full((48, 64), 20 * level, np.uint8))[1].tobytes()
        time = element('E7', time_ms.to_bytes(4, 'big'))
        block = element('A3', b'\x81\0\0\x80' + jpeg)
        content += bytes.fromhex('1F43B675') + unknown + time + block
    path.write_bytes(content)
    return path


def test_a_video_without_a_frame_rate_keeps_the_times_of_its_frames(tmp_path):
    times_ms = [0, 230, 410, 655, 700, 1900]
    source = open_source(matroska(tmp_path / 'browser.webm', times_ms))
    assert len(source) == describe_recording(tmp_path / 'browser.webm')['images'] == 6
    assert [frame.stamp_ns for frame in source] == [time * 1_000_000 for time in times_ms]
    assert source.warnings == []


def test_frames_without_times_are_a_frame_rate_apart(video, monkeypatch):
    capture, time = cv2.VideoCapture, cv2.CAP_PROP_POS_MSEC

    class Timeless:
        def __init__(self, path):
            self.opened = capture(path)

        def __getattr__(self, name):
            return getattr(self.opened, name)

        def get(self, name):
            return 0.0 if name == time else self.opened.get(name)

    monkeypatch.setattr(cv2, 'VideoCapture', Timeless)
    assert [frame.stamp_ns for frame in open_source(video)] == [0, 50_000_000, 100_000_000]
